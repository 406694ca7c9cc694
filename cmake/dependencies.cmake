# Everything comes from Debian 12 packages; scripts/install_dependencies.sh names them.
find_package(absl REQUIRED)
find_package(Eigen3 3.4 REQUIRED NO_MODULE)
find_package(TBB REQUIRED)
find_package(CLI11 REQUIRED)
find_package(nlohmann_json REQUIRED)
find_package(fmt REQUIRED)
find_package(hwy REQUIRED)
find_package(embree 3 REQUIRED)
find_package(GTest REQUIRED)
find_package(PkgConfig REQUIRED)
pkg_check_modules(zstd REQUIRED IMPORTED_TARGET libzstd)
pkg_check_modules(xxhash REQUIRED IMPORTED_TARGET libxxhash)
pkg_check_modules(geographic REQUIRED IMPORTED_TARGET geographiclib)
find_package(Threads REQUIRED)

# S2 comes without a CMake package of its own.
find_path(S2_INCLUDE_DIR s2/s2cell_id.h REQUIRED)
find_library(S2_LIBRARY s2 REQUIRED)
add_library(s2 UNKNOWN IMPORTED)
set_target_properties(s2 PROPERTIES
  IMPORTED_LOCATION ${S2_LIBRARY} INTERFACE_INCLUDE_DIRECTORIES ${S2_INCLUDE_DIR})

# Debian's RocksDB has a CMake package, but one that asks for packages that it does not depend on.
find_path(ROCKSDB_INCLUDE_DIR rocksdb/db.h REQUIRED)
find_library(ROCKSDB_LIBRARY rocksdb REQUIRED)
add_library(rocksdb UNKNOWN IMPORTED)
set_target_properties(rocksdb PROPERTIES
  IMPORTED_LOCATION ${ROCKSDB_LIBRARY} INTERFACE_INCLUDE_DIRECTORIES ${ROCKSDB_INCLUDE_DIR})

# RapidCheck comes without a CMake package of its own.
find_path(RAPIDCHECK_INCLUDE_DIR rapidcheck.h REQUIRED)
find_library(RAPIDCHECK_LIBRARY rapidcheck REQUIRED)
add_library(rapidcheck UNKNOWN IMPORTED)
set_target_properties(rapidcheck PROPERTIES
  IMPORTED_LOCATION ${RAPIDCHECK_LIBRARY} INTERFACE_INCLUDE_DIRECTORIES ${RAPIDCHECK_INCLUDE_DIR})

# Debian's OpenCVConfig.cmake comes only with the package of all modules, which draws in VTK and Qt;
# the modules needed are found one by one.
find_path(OPENCV_INCLUDE_DIR opencv2/core.hpp PATH_SUFFIXES opencv4 REQUIRED)
foreach(module core imgproc imgcodecs features2d calib3d dnn)
  find_library(OPENCV_${module}_LIBRARY opencv_${module} REQUIRED)
  add_library(opencv_${module} UNKNOWN IMPORTED)
  set_target_properties(opencv_${module} PROPERTIES
    IMPORTED_LOCATION ${OPENCV_${module}_LIBRARY}
    INTERFACE_INCLUDE_DIRECTORIES ${OPENCV_INCLUDE_DIR})
endforeach()

find_program(CARMAP_CCACHE ccache)
if(CARMAP_CCACHE)
  set(CMAKE_CXX_COMPILER_LAUNCHER ${CARMAP_CCACHE})
endif()
