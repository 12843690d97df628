# The fuzz targets: test/fuzz/fuzz_NAME.cpp becomes the program fuzz_NAME, which libFuzzer drives.
# ./scripts/fuzz builds and runs them.

add_custom_target(fuzz_targets)
file(GLOB fuzz_sources CONFIGURE_DEPENDS test/fuzz/fuzz_*.cpp)
foreach(source IN LISTS fuzz_sources)
  get_filename_component(name ${source} NAME_WE)
  if(name STREQUAL fuzz_urdf AND NOT TARGET constraint_sim_urdf)
    message(STATUS "urdfdom is not there: ${name} is left out")
    continue()
  endif()
  add_executable(${name} ${source})
  constraint_sim_own_code(${name})
  target_include_directories(${name} PRIVATE test/engine)  # custom_types.h
  target_link_libraries(${name} PRIVATE constraint_sim_engine)
  if(name STREQUAL fuzz_urdf)
    target_link_libraries(${name} PRIVATE constraint_sim_urdf)
  endif()
  target_link_options(${name} PRIVATE -fsanitize=fuzzer)
  add_dependencies(fuzz_targets ${name})
endforeach()
