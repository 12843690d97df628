# The fuzz targets: test/fuzz/fuzz_NAME.cpp becomes the program fuzz_NAME, which libFuzzer drives.
# ./scripts/fuzz builds and runs them.

add_custom_target(fuzz_targets)

# Adds a target that links ARGN.
function(constraint_sim_add_fuzz_target name)
  add_executable(fuzz_${name} test/fuzz/fuzz_${name}.cpp)
  constraint_sim_own_code(fuzz_${name})
  target_include_directories(fuzz_${name} PRIVATE test/engine)  # custom_types.h
  target_link_libraries(fuzz_${name} PRIVATE constraint_sim_engine ${ARGN})
  target_link_options(fuzz_${name} PRIVATE -fsanitize=fuzzer)
  set_target_properties(fuzz_${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR})
  add_dependencies(fuzz_targets fuzz_${name})
endfunction()

constraint_sim_add_fuzz_target(scene)
constraint_sim_add_fuzz_target(snapshot)
constraint_sim_add_fuzz_target(edits)
if(TARGET constraint_sim_urdf)
  constraint_sim_add_fuzz_target(urdf constraint_sim_urdf)
else()
  message(STATUS "urdfdom is not there: fuzz_urdf is left out")
endif()
if(CONSTRAINT_SIM_ROS)
  constraint_sim_add_fuzz_target(services constraint_sim_urdf constraint_sim_stepper ${catkin_LIBRARIES})
  # Files of the node that need no master. All files of the node would take several minutes to compile.
  set(fuzzed_node_sources)
  foreach(name IN ITEMS actuator_efforts body_messages command_changes constraint_messages constraint_state conversions edits
      frame_follower frames geometry_queries laws marker_set parameters poll_pause robots scenes snapshots)
    list(APPEND fuzzed_node_sources src/ros/${name}.cpp)
  endforeach()
  if(dynamic_reconfigure_FOUND)
    list(APPEND fuzzed_node_sources src/ros/reconfigure.cpp)
    target_compile_definitions(fuzz_services PRIVATE CONSTRAINT_SIM_DYNAMIC_RECONFIGURE)
    target_include_directories(fuzz_services SYSTEM PRIVATE ${dynamic_reconfigure_INCLUDE_DIRS})
  endif()
  target_sources(fuzz_services PRIVATE ${fuzzed_node_sources})
  constraint_sim_units(fuzz_services 1000 ${fuzzed_node_sources})
  target_include_directories(fuzz_services SYSTEM PRIVATE
    ${CATKIN_DEVEL_PREFIX}/${CATKIN_GLOBAL_INCLUDE_DESTINATION} ${catkin_INCLUDE_DIRS})
  add_dependencies(fuzz_services ${PROJECT_NAME}_generate_messages_cpp)
else()
  message(STATUS "ROS is not there: fuzz_services is left out")
endif()
