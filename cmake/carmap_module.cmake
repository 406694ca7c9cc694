# Flags that every target of the project is built with.
add_library(carmap_flags INTERFACE)
target_compile_options(carmap_flags INTERFACE
  -Wall -Wextra -Wpedantic -Wshadow -Wnon-virtual-dtor -Werror
  # OpenCV's headers add enumerators of different enumerations in inline functions.
  -Wno-deprecated-enum-enum-conversion
  # Designated initialisers leave members at their defaults on purpose.
  -Wno-missing-field-initializers)
if(CMAKE_SYSTEM_PROCESSOR STREQUAL "x86_64")
  # Arithmetic in vectors of 16 bytes, the heap's alignment: with wider ones Eigen splits sums by where
  # an array happens to lie, and the last bits differ from run to run. What is hot in the front end is
  # compiled for wider ones too, of which the best is chosen when the program runs (feature/).
  target_compile_options(carmap_flags INTERFACE -march=x86-64-v2)
  target_compile_definitions(carmap_flags INTERFACE EIGEN_MAX_ALIGN_BYTES=16
    # AES instructions are not used, and Highway would do without vectors where they are not allowed.
    HWY_DISABLE_PCLMUL_AES)
endif()
target_include_directories(carmap_flags INTERFACE ${PROJECT_SOURCE_DIR}/src)
if(CARMAP_SANITIZE)
  # GCC 12 takes much of the standard library for uninitialised when it is instrumented.
  target_compile_options(carmap_flags INTERFACE
    -fsanitize=${CARMAP_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=all
    $<$<CXX_COMPILER_ID:GNU>:-Wno-maybe-uninitialized>)
  target_link_options(carmap_flags INTERFACE -fsanitize=${CARMAP_SANITIZE})
endif()
if(CARMAP_SANITIZE MATCHES "thread")
  # Every program, that is; libraries pass it on.
  target_sources(carmap_flags INTERFACE
    $<$<STREQUAL:$<TARGET_PROPERTY:TYPE>,EXECUTABLE>:${PROJECT_SOURCE_DIR}/tests/thread_sanitizer.cc>)
  target_link_libraries(carmap_flags INTERFACE TBB::tbb)
endif()

# carmap_module(NAME SOURCES a.cc ... DEPENDS x ... TESTS a_test.cc ... TEST_DEPENDS y ...)
#
# A module of src/carmap: the library carmap_NAME and, beside the code, one test program
# NAME_test made of all its TESTS.
function(carmap_module name)
  cmake_parse_arguments(ARG "" "" "SOURCES;DEPENDS;TESTS;TEST_DEPENDS" ${ARGN})
  if(ARG_SOURCES)
    add_library(carmap_${name} STATIC ${ARG_SOURCES})
    target_link_libraries(carmap_${name} PUBLIC carmap_flags ${ARG_DEPENDS})
  else()
    add_library(carmap_${name} INTERFACE)
    target_link_libraries(carmap_${name} INTERFACE carmap_flags ${ARG_DEPENDS})
  endif()
  if(ARG_TESTS)
    add_executable(${name}_test ${ARG_TESTS})
    target_link_libraries(${name}_test PRIVATE carmap_${name} ${ARG_TEST_DEPENDS} GTest::gmock GTest::gtest_main)
    add_test(NAME ${name} COMMAND ${name}_test)
  endif()
endfunction()
