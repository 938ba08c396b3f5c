# Helpers, so that a module or a test costs three lines.

# fovea_module(NAME SRCS a.cc ... [DEPS public targets] [PRIVATE_DEPS targets])
# A static library fovea_NAME with the alias fovea::NAME.
function(fovea_module name)
  cmake_parse_arguments(arg "" "" "SRCS;DEPS;PRIVATE_DEPS" ${ARGN})
  add_library(fovea_${name} STATIC ${arg_SRCS})
  add_library(fovea::${name} ALIAS fovea_${name})
  target_link_libraries(fovea_${name} PUBLIC fovea_options ${arg_DEPS} PRIVATE ${arg_PRIVATE_DEPS})
endfunction()

# fovea_test(NAME SRCS a_test.cc ... DEPS targets LABEL unit|property|golden|system|fault|slow [TIMEOUT s])
# A GoogleTest program; each of its tests is a ctest test with that one label.
# Tests see FOVEA_SOURCE_DIR and FOVEA_BINARY_DIR, and FOVEA_TEST_DATA where the shared volumes are.
function(fovea_test name)
  cmake_parse_arguments(arg "" "LABEL;TIMEOUT" "SRCS;DEPS" ${ARGN})
  if(NOT arg_TIMEOUT)
    set(arg_TIMEOUT 120)
  endif()
  add_executable(${name} ${arg_SRCS})
  target_link_libraries(${name} PRIVATE fovea_options ${arg_DEPS} GTest::gmock_main)
  target_compile_definitions(${name} PRIVATE
    FOVEA_SOURCE_DIR="${PROJECT_SOURCE_DIR}" FOVEA_BINARY_DIR="${PROJECT_BINARY_DIR}")
  gtest_discover_tests(${name} DISCOVERY_MODE PRE_TEST DISCOVERY_TIMEOUT 60
    PROPERTIES LABELS ${arg_LABEL} TIMEOUT ${arg_TIMEOUT})
endfunction()
