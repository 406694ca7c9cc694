# Rejects a header x.h that may be included twice, and a source x.cc beside it that does not include
# it before all else, so that the build proves that x.h compiles alone.
#
#   cmake -DROOT=SOURCE_FOLDER -P check_headers.cmake
cmake_minimum_required(VERSION 3.25)

# Sets `code` to the file's first line that is neither blank nor a comment.
function(read_first_line_of_code file)
  file(STRINGS "${ROOT}/${file}" code ENCODING UTF-8 LIMIT_COUNT 1 REGEX "^[ \t]*[^ \t/]")
  set(code "${code}" PARENT_SCOPE)
endfunction()

set(faults 0)
file(GLOB_RECURSE headers RELATIVE "${ROOT}" "${ROOT}/*.h")
foreach(header IN LISTS headers)
  read_first_line_of_code("${header}")
  if(NOT code STREQUAL "#pragma once")
    message("${header}: begins with `${code}`; write `#pragma once` before all other code")
    math(EXPR faults "${faults} + 1")
  endif()
  string(REGEX REPLACE "\\.h$" ".cc" source "${header}")
  if(EXISTS "${ROOT}/${source}")
    read_first_line_of_code("${source}")
    if(NOT code STREQUAL "#include \"${header}\"")
      message("${source}: begins with `${code}`; include \"${header}\" before all else")
      math(EXPR faults "${faults} + 1")
    endif()
  endif()
endforeach()

list(LENGTH headers count)
if(count EQUAL 0)
  message(FATAL_ERROR "${ROOT}: no header in it; pass -DROOT=<the repository's src folder>")
elseif(faults GREATER 0)
  message(FATAL_ERROR "${faults} faults; tests/headers/CMakeLists.txt says why these are some")
endif()
message(STATUS "${count} headers: each guarded, and first where it is its source's own")
