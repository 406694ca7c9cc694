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

cmake_minimum_required(VERSION 3.25)
if(NOT IS_DIRECTORY "${ROOT}/carmap")
  message(FATAL_ERROR "${ROOT}: no folder carmap in it; pass -DROOT=<the repository's src folder>")
endif()

set(layer 0)
foreach(peers IN LISTS layers)
  string(REPLACE " " ";" peers "${peers}")
  foreach(module IN LISTS peers)
    set(layer_of_${module} ${layer})
  endforeach()
  math(EXPR layer "${layer} + 1")
endforeach()

# Sets ${result} to what is wrong with the include of `target` in `module`; empty if nothing is.
function(judge_include module target result)
  if(NOT target MATCHES "^carmap/([^/]+)/")
    set(${result} "write it from the source folder, \"carmap/<module>/<file>\"" PARENT_SCOPE)
    return()
  endif()
  set(other ${CMAKE_MATCH_1})
  if(NOT DEFINED layer_of_${other})
    set(${result} "module ${other} is in no layer; add it to tests/check_layers.cmake" PARENT_SCOPE)
  elseif(other STREQUAL module OR layer_of_${other} LESS layer_of_${module})
    set(${result} "" PARENT_SCOPE)
  elseif(layer_of_${other} EQUAL layer_of_${module})
    set(${result} "${module} and ${other} are peers and do not know each other" PARENT_SCOPE)
  else()
    set(${result} "${other} is a layer above ${module}" PARENT_SCOPE)
  endif()
endfunction()

set(faults 0)
set(includes_seen 0)
file(GLOB_RECURSE files RELATIVE "${ROOT}" "${ROOT}/carmap/*.h" "${ROOT}/carmap/*.cc")
foreach(file IN LISTS files)
  string(REGEX REPLACE "^carmap/([^/]+)/.*" "\\1" module "${file}")
  if(NOT DEFINED layer_of_${module})
    message("${file}: module ${module} is in no layer; add it to tests/check_layers.cmake")
    math(EXPR faults "${faults} + 1")
    continue()
  endif()
  # Every include in quotes, and those of our own headers that stand in angle brackets.
  file(STRINGS "${ROOT}/${file}" lines REGEX "^[ \t]*#[ \t]*include[ \t]*(\"|<carmap/)")
  foreach(line IN LISTS lines)
    string(REGEX REPLACE "^[^\"<]*[\"<]([^\">]*)[\">].*" "\\1" target "${line}")
    math(EXPR includes_seen "${includes_seen} + 1")
    judge_include(${module} "${target}" fault)
    if(fault)
      message("${file}: includes ${target}: ${fault}")
      math(EXPR faults "${faults} + 1")
    endif()
  endforeach()
endforeach()

if(faults GREATER 0)
  message(FATAL_ERROR "${faults} includes break the layers, which CONTRIBUTING.md explains")
endif()
list(LENGTH files file_count)
message(STATUS "${file_count} files, ${includes_seen} includes: layers kept")
