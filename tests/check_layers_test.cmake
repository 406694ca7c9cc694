# Proves that check_layers.cmake rejects what it must, on made-up modules, and accepts the rest.
#
#   cmake -DSCRATCH=FOLDER -P check_layers_test.cmake
cmake_minimum_required(VERSION 3.25)

# A source tree of one file with one line in it; sets `code` and `output` to the check's answer.
function(check_made_up_file file line)
  file(REMOVE_RECURSE "${SCRATCH}")
  file(WRITE "${SCRATCH}/carmap/${file}" "#pragma once\n\n${line}\n")
  execute_process(
    COMMAND ${CMAKE_COMMAND} -DROOT=${SCRATCH} -P ${CMAKE_CURRENT_LIST_DIR}/check_layers.cmake
    RESULT_VARIABLE code OUTPUT_VARIABLE output ERROR_VARIABLE output)
  file(REMOVE_RECURSE "${SCRATCH}")
  set(code "${code}" PARENT_SCOPE)
  set(output "${output}" PARENT_SCOPE)
endfunction()

function(expect_rejected file line reason)
  check_made_up_file("${file}" "${line}")
  if(code EQUAL 0 OR NOT output MATCHES "${file}: .*${reason}")
    message(SEND_ERROR "`${line}` in ${file} must be rejected (${reason}), but (${code}): ${output}")
  endif()
endfunction()

function(expect_accepted file line)
  check_made_up_file("${file}" "${line}")
  if(NOT code EQUAL 0 OR NOT output MATCHES "1 files, [01] includes: layers kept")
    message(SEND_ERROR "`${line}` in ${file} must be accepted, but (${code}): ${output}")
  endif()
endfunction()

expect_rejected(base/bad.h "#include \"carmap/map/lean_map.h\"" "map is a layer above base")
expect_rejected(map/bad_test.cc "#include \"carmap/format/codec.h\"" "format is a layer above map")
expect_rejected(localize/bad.cc "  #  include\t\"carmap/slam/x.h\"  // why" "slam is a layer above")
expect_rejected(base/bad.h "#include <carmap/map/lean_map.h>" "map is a layer above base")
expect_rejected(format/deep/bad.h "#include \"carmap/index/x.h\"" "format and index are peers")
expect_rejected(index/bad.h "#include \"carmap/format/x.h\"" "index and format are peers")
expect_rejected(feature/bad.h "#include \"carmap/dataset/x.h\"" "feature and dataset are peers")
expect_rejected(slam/bad.h "#include \"carmap/update/x.h\"" "slam and update are peers")
expect_rejected(vehicle/bad.h "#include \"carmap/ingest/x.h\"" "vehicle and ingest are peers")
expect_rejected(base/bad.h "#include \"../map/lean_map.h\"" "write it from the source folder")
expect_rejected(base/bad.h "#include \"apps/carmap/x.h\"" "write it from the source folder")
expect_rejected(base/bad.h "#include \"carmap/novel/x.h\"" "novel is in no layer")
expect_rejected(novel/bad.h "#include <vector>" "novel is in no layer")

# Rooms of a module.
expect_rejected(sim/mesh/bad.h "#include \"carmap/sim/town/world.h\"" "sim/town is a layer above sim/mesh")
expect_rejected(sim/road/bad.h "#include \"carmap/sim/models/models.h\"" "sim/road and sim/models are peers")
expect_rejected(sim/render/bad_test.cc "#include \"carmap/sim/traffic/x.h\"" "sim/render and sim/traffic are")
expect_rejected(sim/traffic/bad.h "#include \"carmap/sim/simulation.h\"" "sim/door is a layer above")
expect_rejected(sim/mesh/bad.h "#include \"carmap/map/lean_map.h\"" "map is a layer above sim")
expect_rejected(sim/bad.h "#include \"carmap/sim/novel/x.h\"" "sim/novel is in no layer")
expect_rejected(sim/novel/bad.h "#include <vector>" "sim/novel is in no layer")
expect_rejected(eval/bad.cc "#include \"carmap/sim/road/route.h\"" "include what is at its door")

expect_accepted(sim/good.h "#include \"carmap/sim/render/renderer.h\"")
expect_accepted(sim/town/good.cc "#include \"carmap/sim/road/route.h\"")
expect_accepted(sim/town/good.cc "#include \"carmap/sim/town/site.h\"")
expect_accepted(sim/mesh/good.cc "#include \"carmap/base/random.h\"")
expect_accepted(eval/good.cc "#include \"carmap/sim/simulation.h\"")
expect_accepted(base/good.h "#include \"carmap/base/time.h\"")
expect_accepted(format/good.h "#include \"carmap/map/lean_map.h\"")
expect_accepted(eval/good.cc "#include \"carmap/base/ids.h\"")
expect_accepted(base/good.h "#include <vector>")
expect_accepted(base/good.h "// says #include \"carmap/map/lean_map.h\" in a comment")
