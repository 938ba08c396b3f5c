# Every find_package of the project is here. All of it comes from Debian 12 (deploy/install-deps.sh).
find_package(Threads REQUIRED)
find_package(PkgConfig REQUIRED)
find_package(absl CONFIG REQUIRED)
include(cmake/Abseil.cmake)
find_package(Protobuf 3.21 REQUIRED)          # module mode: Debian ships no protobuf-config.cmake
find_package(gRPC 1.51 CONFIG REQUIRED)
find_package(OpenSSL 3.0 REQUIRED)            # SHA-256 of tokens, checks of certificates
find_package(TBB 2021 CONFIG REQUIRED)        # before OpenVDB, whose FindTBB then finds the target defined
find_package(fmt 9 CONFIG REQUIRED)
find_package(spdlog 1.10 CONFIG REQUIRED)
find_package(CLI11 2.1 CONFIG REQUIRED)
pkg_check_modules(PROMETHEUS REQUIRED IMPORTED_TARGET GLOBAL prometheus-cpp-core>=1.0)   # /metrics
pkg_check_modules(HTTPLIB REQUIRED IMPORTED_TARGET GLOBAL cpp-httplib>=0.11)   # the admin port
find_package(nlohmann_json 3.11 CONFIG REQUIRED)
find_package(zstd 1.5 CONFIG REQUIRED)
find_package(hwy 1.0.3 CONFIG REQUIRED)       # Highway: SIMD chosen at run time
pkg_check_modules(ISAL REQUIRED IMPORTED_TARGET GLOBAL libisal>=2.30)   # CRC32C; ships no CMake config
find_package(ZLIB REQUIRED)
find_package(SQLite3 3.40 REQUIRED)           # the table of jobs
# Not find_package(NIFTI): the config in Debian's libnifti-dev names files that it does not install.
find_path(NIFTI_INCLUDE nifti2_io.h PATH_SUFFIXES nifti REQUIRED)
find_library(NIFTI2_LIBRARY nifti2 REQUIRED)
add_library(fovea_nifti INTERFACE)
target_include_directories(fovea_nifti SYSTEM INTERFACE ${NIFTI_INCLUDE})
target_link_libraries(fovea_nifti INTERFACE ${NIFTI2_LIBRARY})
find_package(PNG REQUIRED)
find_package(JPEG REQUIRED)
block()                                       # OpenVDB's module folder also holds FindTBB, FindOpenEXR, ...
  list(PREPEND CMAKE_MODULE_PATH "/usr/lib/${CMAKE_LIBRARY_ARCHITECTURE}/cmake/OpenVDB")
  find_package(OpenVDB 10 REQUIRED COMPONENTS openvdb)
endblock()
# Not find_package(OpenImageIO): Debian's config needs packages that openimageio-dev does not bring.
pkg_check_modules(OpenImageIO REQUIRED IMPORTED_TARGET GLOBAL OpenImageIO>=2.4 Imath)
add_library(OpenImageIO::OpenImageIO ALIAS PkgConfig::OpenImageIO)
if(FOVEA_BUILD_TESTS)
  find_package(GTest 1.12 CONFIG REQUIRED)
  pkg_check_modules(BLOSC REQUIRED IMPORTED_TARGET GLOBAL blosc>=1.21)   # to compare ours with
endif()
