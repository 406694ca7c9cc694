# Proves that check_headers.cmake rejects what it must, on a made-up header and its source, and accepts
# the rest.
#
#   cmake -DSCRATCH=FOLDER -P check_headers_test.cmake
cmake_minimum_required(VERSION 3.25)

# Sets `code` and `output` to the check's answer on a.h and, unless it is empty, a.cc.
function(check_made_up header source)
  file(REMOVE_RECURSE "${SCRATCH}")
  file(WRITE "${SCRATCH}/carmap/m/a.h" "${header}")
  if(source)
    file(WRITE "${SCRATCH}/carmap/m/a.cc" "${source}")
  endif()
  execute_process(
    COMMAND ${CMAKE_COMMAND} -DROOT=${SCRATCH} -P ${CMAKE_CURRENT_LIST_DIR}/check_headers.cmake
    RESULT_VARIABLE code OUTPUT_VARIABLE output ERROR_VARIABLE output)
  file(REMOVE_RECURSE "${SCRATCH}")
  set(code "${code}" PARENT_SCOPE)
  set(output "${output}" PARENT_SCOPE)
endfunction()

function(expect_rejected header source reason)
  check_made_up("${header}" "${source}")
  if(code EQUAL 0 OR NOT output MATCHES "${reason}")
    message(SEND_ERROR "must be rejected (${reason}), but (${code}): ${output}\n${header}${source}")
  endif()
endfunction()

function(expect_accepted header source)
  check_made_up("${header}" "${source}")
  if(NOT code EQUAL 0)
    message(SEND_ERROR "must be accepted, but (${code}): ${output}\n${header}${source}")
  endif()
endfunction()

set(guarded "// What it is for (§3.2).\n#pragma once\n#include <vector>\n")
set(own "#include \"carmap/m/a.h\"\n")

expect_rejected("#include <vector>\n" "" "a.h: begins with `#include <vector>`")
expect_rejected("#include <vector>\n#pragma once\n" "" "a.h: begins with `#include <vector>`")
expect_rejected("// No code.\n" "" "a.h: begins with ``")
expect_rejected("${guarded}" "#include <string>\n${own}" "a.cc: begins with `#include <string>`")
expect_rejected("${guarded}" "#define X\n${own}" "a.cc: begins with `#define X`")
expect_rejected("${guarded}" "#include \"carmap/m/b.h\"\n${own}" "a.cc: begins with `#include .carmap/m/b.h")
expect_rejected("${guarded}" "#include <vector>\n" "a.cc: begins with")

expect_accepted("${guarded}" "")
expect_accepted("${guarded}" "${own}#include <string>\n")
expect_accepted("${guarded}" "// Façades: why.\n\n  // And how.\n${own}")
