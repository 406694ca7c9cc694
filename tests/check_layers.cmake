# Rejects an #include that goes up the layers of src/carmap, or sideways to a peer.
#
#   cmake -DROOT=SOURCE_FOLDER -P check_layers.cmake
#
# Each line below is a layer, the lowest first. A module may include itself and modules of the lines
# above its own; modules of one line are peers and do not know each other (so format/ cannot see
# index/, which is what keeps maps lean).
set(layers
  "base"
  "geometry"
  "feature dataset"
  "solve semantics sim"
  "map"
  "index format"
  "localize"
  "update slam store"
  "vehicle ingest"
  "proto"
  "service client"
  "eval")

# The same inside a module whose folder has rooms. What lies in none of them is the module's door: it
# alone is included by other modules.
set(modules_with_rooms sim)
set(rooms_of_sim
  "mesh"
  "road models"
  "town"
  "render traffic"
  "door")

cmake_minimum_required(VERSION 3.25)
if(NOT IS_DIRECTORY "${ROOT}/carmap")
  message(FATAL_ERROR "${ROOT}: no folder carmap in it; pass -DROOT=<the repository's src folder>")
endif()

# Sets layer_of_<folder> to the number of its line for each folder named in ARGN.
function(number_layers parent)
  set(layer 0)
  foreach(peers IN LISTS ARGN)
    string(REPLACE " " ";" peers "${peers}")
    foreach(folder IN LISTS peers)
      set(layer_of_${parent}${folder} ${layer} PARENT_SCOPE)
    endforeach()
    math(EXPR layer "${layer} + 1")
  endforeach()
endfunction()

number_layers("" ${layers})
foreach(module IN LISTS modules_with_rooms)
  number_layers("${module}/" ${rooms_of_${module}})
endforeach()

# Sets `module` and, in modules with rooms, `room` ("sim/road") to where a file of src/ belongs.
function(locate file)
  string(REGEX MATCH "^carmap/([^/]+)/(([^/]+)/)?" folders "${file}")
  set(module "${CMAKE_MATCH_1}")
  set(room "")
  if(module IN_LIST modules_with_rooms)
    set(room "${module}/door")
    if(CMAKE_MATCH_3)
      set(room "${module}/${CMAKE_MATCH_3}")
    endif()
  endif()
  set(module "${module}" PARENT_SCOPE)
  set(room "${room}" PARENT_SCOPE)
endfunction()

# Sets ${result} to why `from` may not include `to`, modules or rooms of one; empty if it may.
function(compare_layers from to result)
  set(reason "")
  if(NOT DEFINED layer_of_${to})
    set(reason "${to} is in no layer; add it to tests/check_layers.cmake")
  elseif(from STREQUAL to OR layer_of_${to} LESS layer_of_${from})
  elseif(layer_of_${to} EQUAL layer_of_${from})
    set(reason "${from} and ${to} are peers and do not know each other")
  else()
    set(reason "${to} is a layer above ${from}")
  endif()
  set(${result} "${reason}" PARENT_SCOPE)
endfunction()

# Sets ${result} to what is wrong with the include of `target` in `file`; empty if nothing is.
function(judge_include file target result)
  if(NOT target MATCHES "^carmap/([^/]+)/")
    set(${result} "write it from the source folder, \"carmap/<module>/<file>\"" PARENT_SCOPE)
    return()
  endif()
  locate("${file}")
  set(own_module "${module}")
  set(own_room "${room}")
  locate("${target}")
  if(NOT module STREQUAL own_module)
    compare_layers("${own_module}" "${module}" reason)
    if(NOT reason AND room AND NOT room STREQUAL "${module}/door")
      set(reason "${room} is a room of ${module}; other modules include what is at its door")
    endif()
  elseif(room)
    compare_layers("${own_room}" "${room}" reason)
  else()
    set(reason "")
  endif()
  set(${result} "${reason}" PARENT_SCOPE)
endfunction()

set(faults 0)
set(includes_seen 0)
file(GLOB_RECURSE files RELATIVE "${ROOT}" "${ROOT}/carmap/*.h" "${ROOT}/carmap/*.cc")
foreach(file IN LISTS files)
  locate("${file}")
  set(folders ${module} ${room})
  list(GET folders -1 innermost)
  if(NOT DEFINED layer_of_${innermost})
    message("${file}: ${innermost} is in no layer; add it to tests/check_layers.cmake")
    math(EXPR faults "${faults} + 1")
    continue()
  endif()
  # Every include in quotes, and those of our own headers that stand in angle brackets.
  file(STRINGS "${ROOT}/${file}" lines REGEX "^[ \t]*#[ \t]*include[ \t]*(\"|<carmap/)")
  foreach(line IN LISTS lines)
    string(REGEX REPLACE "^[^\"<]*[\"<]([^\">]*)[\">].*" "\\1" target "${line}")
    math(EXPR includes_seen "${includes_seen} + 1")
    judge_include("${file}" "${target}" fault)
    if(fault)
      message("${file}: includes ${target}: ${fault}")
      math(EXPR faults "${faults} + 1")
    endif()
  endforeach()
endforeach()

if(NOT files)
  message(FATAL_ERROR "${ROOT}/carmap: no sources in it; pass the folder's full path")
elseif(faults GREATER 0)
  message(FATAL_ERROR "${faults} includes break the layers, which CONTRIBUTING.md explains")
endif()
list(LENGTH files file_count)
message(STATUS "${file_count} files, ${includes_seen} includes: layers kept")
