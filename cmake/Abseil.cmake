# fovea_absl: Abseil for all that we build. A program with the property FOVEA_ABSL_ARCHIVES gets it from its archives and starts
# 1 ms sooner (docs/decisions/0027): it is 25 small shared libraries, which take a quarter of the start of `fovea`. Not for
# programs that load gRPC, whose shared Abseil would be a second one beside that.
pkg_check_modules(ABSL REQUIRED absl_status absl_statusor absl_strings)
set(archives "")
foreach(name IN LISTS ABSL_STATIC_LIBRARIES)
  if(name MATCHES "^absl_")
    find_library(FOVEA_${name}_ARCHIVE lib${name}.a REQUIRED)
    string(APPEND archives ",${FOVEA_${name}_ARCHIVE}")
  endif()
endforeach()
set(wants_archives "$<BOOL:$<TARGET_PROPERTY:FOVEA_ABSL_ARCHIVES>>")
add_library(fovea_absl INTERFACE)
foreach(shared status statusor strings)
  target_link_libraries(fovea_absl INTERFACE "$<$<NOT:${wants_archives}>:absl::${shared}>")
endforeach()
# One word, so that the group stays together.
string(REPLACE "," "$<COMMA>" archives "-Wl,--start-group${archives},--end-group")
target_link_libraries(fovea_absl INTERFACE "$<${wants_archives}:${archives}>")
