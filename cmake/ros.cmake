# The ROS shell: messages, node, and where catkin wants things installed.

find_package(catkin REQUIRED COMPONENTS
  actionlib actionlib_msgs diagnostic_msgs geometry_msgs interactive_markers message_generation nav_msgs nodelet pluginlib rosbag_storage roscpp
  rosgraph_msgs roslib sensor_msgs std_msgs std_srvs tf2_msgs tf2_ros topic_tools trajectory_msgs visualization_msgs
)

if(CONSTRAINT_SIM_PYTHON AND NOT CONSTRAINT_SIM_SANITIZE)
  catkin_python_setup()  # before messages are generated: both share the package's __init__.py
endif()
add_message_files(DIRECTORY msg)
add_service_files(DIRECTORY srv)
generate_messages(DEPENDENCIES geometry_msgs std_msgs)

catkin_package(
  INCLUDE_DIRS include
  LIBRARIES constraint_sim_engine
  CATKIN_DEPENDS geometry_msgs message_runtime std_msgs
  DEPENDS EIGEN3
  CFG_EXTRAS constraint_sim-engine.cmake
)

file(GLOB ros_sources RELATIVE ${CMAKE_CURRENT_SOURCE_DIR} CONFIGURE_DEPENDS src/ros/*.cpp)
list(REMOVE_ITEM ros_sources src/ros/node_main.cpp src/ros/nodelet.cpp src/ros/reconfigure.cpp)
# Only its messages: without them the node has no parameters of dynamic_reconfigure.
find_package(dynamic_reconfigure QUIET)
if(dynamic_reconfigure_FOUND)
  list(APPEND ros_sources src/ros/reconfigure.cpp)
endif()
add_library(constraint_sim_ros STATIC ${ros_sources})
constraint_sim_units(constraint_sim_ros 15 ${ros_sources})
constraint_sim_shell_code(constraint_sim_ros)
set_target_properties(constraint_sim_ros PROPERTIES POSITION_INDEPENDENT_CODE ON)
# Headers of control_msgs, which Debian does not have: types and their sums are those of the package.
set(control_msgs ${CMAKE_CURRENT_BINARY_DIR}/control_msgs)
set(control_msgs_headers)
set(action_parts Action ActionGoal ActionResult ActionFeedback Goal Result Feedback)
list(TRANSFORM action_parts PREPEND FollowJointTrajectory)
list(TRANSFORM action_parts APPEND .msg OUTPUT_VARIABLE action_files)
list(TRANSFORM action_files PREPEND ${control_msgs}/msg/)
add_custom_command(OUTPUT ${action_files} ${control_msgs}/msg/JointTolerance.msg
  COMMAND ${CMAKE_COMMAND} -E make_directory ${control_msgs}/msg
  COMMAND ${CMAKE_COMMAND} -E copy ${CMAKE_CURRENT_SOURCE_DIR}/cmake/control_msgs/JointTolerance.msg ${control_msgs}/msg
  COMMAND ${CATKIN_ENV} ${PYTHON_EXECUTABLE} ${GENACTION_BIN}
    ${CMAKE_CURRENT_SOURCE_DIR}/cmake/control_msgs/FollowJointTrajectory.action -o ${control_msgs}/msg
  DEPENDS cmake/control_msgs/JointTolerance.msg cmake/control_msgs/FollowJointTrajectory.action)
set(message_paths -Icontrol_msgs:${control_msgs}/msg)
foreach(package actionlib_msgs geometry_msgs std_msgs trajectory_msgs)
  list(APPEND message_paths "-I${package}:${${package}_DIR}/../msg")
endforeach()
foreach(part JointTolerance ${action_parts})
  set(header ${control_msgs}/include/control_msgs/${part}.h)
  add_custom_command(OUTPUT ${header}
    COMMAND ${CATKIN_ENV} ${PYTHON_EXECUTABLE} ${GENCPP_BIN} ${control_msgs}/msg/${part}.msg ${message_paths}
      -p control_msgs -o ${control_msgs}/include/control_msgs -e ${GENCPP_TEMPLATE_DIR}
    DEPENDS ${action_files} ${control_msgs}/msg/JointTolerance.msg)
  list(APPEND control_msgs_headers ${header})
endforeach()
add_custom_target(constraint_sim_control_msgs DEPENDS ${control_msgs_headers})
target_include_directories(constraint_sim_ros SYSTEM BEFORE PUBLIC ${control_msgs}/include)

add_dependencies(constraint_sim_ros constraint_sim_control_msgs ${PROJECT_NAME}_generate_messages_cpp)
# SYSTEM also takes the generated headers out of our own warnings
target_include_directories(constraint_sim_ros SYSTEM PUBLIC
  ${CATKIN_DEVEL_PREFIX}/${CATKIN_GLOBAL_INCLUDE_DESTINATION} ${catkin_INCLUDE_DIRS})
find_package(OpenSSL REQUIRED)
target_link_libraries(constraint_sim_ros PUBLIC constraint_sim_stepper constraint_sim_urdf ${catkin_LIBRARIES}
  OpenSSL::Crypto)

if(dynamic_reconfigure_FOUND)
  target_compile_definitions(constraint_sim_ros PUBLIC CONSTRAINT_SIM_DYNAMIC_RECONFIGURE)
  target_include_directories(constraint_sim_ros SYSTEM PUBLIC ${dynamic_reconfigure_INCLUDE_DIRS})
else()
  message(STATUS "dynamic_reconfigure is not there: options are set by set_options alone")
endif()

add_executable(constraint_sim_node src/ros/node_main.cpp)
constraint_sim_shell_code(constraint_sim_node)
target_link_libraries(constraint_sim_node PRIVATE constraint_sim_ros)

add_executable(constraint_sim_rviz_config src/tools/rviz_config.cpp)
set_target_properties(constraint_sim_rviz_config PROPERTIES OUTPUT_NAME rviz_config)
constraint_sim_shell_code(constraint_sim_rviz_config)
target_link_libraries(constraint_sim_rviz_config PRIVATE constraint_sim_ros yaml-cpp)

if(CONSTRAINT_SIM_EXTRAS)
  # `replay` is the name that users type; a target of it would be one of many
  add_executable(constraint_sim_replay src/tools/replay.cpp)
  set_target_properties(constraint_sim_replay PROPERTIES OUTPUT_NAME replay)
  constraint_sim_shell_code(constraint_sim_replay)
  target_link_libraries(constraint_sim_replay PRIVATE constraint_sim_ros)

  add_executable(client_example examples/client.cpp)
  constraint_sim_shell_code(client_example)
  add_dependencies(client_example ${PROJECT_NAME}_generate_messages_cpp)
  target_include_directories(client_example SYSTEM PRIVATE
    ${CATKIN_DEVEL_PREFIX}/${CATKIN_GLOBAL_INCLUDE_DESTINATION} ${catkin_INCLUDE_DIRS})
  target_link_libraries(client_example PRIVATE ${catkin_LIBRARIES})

  add_library(constraint_sim_nodelet SHARED src/ros/nodelet.cpp)
  constraint_sim_shell_code(constraint_sim_nodelet)
  target_link_libraries(constraint_sim_nodelet PRIVATE constraint_sim_ros)

  file(GLOB sensor_sources CONFIGURE_DEPENDS src/sensors/*.cpp)
  add_library(constraint_sim_sensors SHARED ${sensor_sources})
  constraint_sim_shell_code(constraint_sim_sensors)
  target_include_directories(constraint_sim_sensors SYSTEM PRIVATE ${catkin_INCLUDE_DIRS})
  target_link_libraries(constraint_sim_sensors PRIVATE constraint_sim_engine ${catkin_LIBRARIES})

  install(TARGETS client_example constraint_sim_replay RUNTIME DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
  install(TARGETS constraint_sim_nodelet constraint_sim_sensors LIBRARY DESTINATION ${CATKIN_PACKAGE_LIB_DESTINATION})
endif()

include(cmake/panel.cmake)

constraint_sim_add_benchmark(constraint_sim_marker_costs bench/ros/marker_costs.cpp constraint_sim_ros)

# In the devel space, where other packages and rosrun look: these targets are defined before catkin says where.
set_target_properties(constraint_sim_engine PROPERTIES
  ARCHIVE_OUTPUT_DIRECTORY ${CATKIN_DEVEL_PREFIX}/${CATKIN_GLOBAL_LIB_DESTINATION})
set_target_properties(constraint_sim_run constraint_sim_error_table PROPERTIES
  RUNTIME_OUTPUT_DIRECTORY ${CATKIN_DEVEL_PREFIX}/${CATKIN_PACKAGE_BIN_DESTINATION})
install(TARGETS constraint_sim_engine EXPORT constraint_sim
  ARCHIVE DESTINATION ${CATKIN_PACKAGE_LIB_DESTINATION})
install(EXPORT constraint_sim NAMESPACE constraint_sim:: FILE constraint_sim_engine_targets.cmake
  DESTINATION ${CATKIN_PACKAGE_SHARE_DESTINATION}/cmake)
export(EXPORT constraint_sim NAMESPACE constraint_sim::
  FILE ${CMAKE_CURRENT_BINARY_DIR}/constraint_sim_engine_targets.cmake)
install(TARGETS constraint_sim_node constraint_sim_run constraint_sim_rviz_config constraint_sim_error_table
  RUNTIME DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
install(FILES nodelet_plugins.xml rviz_plugins.xml sensor_plugins.xml DESTINATION ${CATKIN_PACKAGE_SHARE_DESTINATION})
install(DIRECTORY include/constraint_sim/ DESTINATION ${CATKIN_PACKAGE_INCLUDE_DESTINATION})
install(DIRECTORY launch config DESTINATION ${CATKIN_PACKAGE_SHARE_DESTINATION})
# not executable where they lie: rosrun would find them there as well as where they are installed
set(python_programs src/tools/bag_report src/tools/simulator_bag src/tools/watch_error)
if(CONSTRAINT_SIM_PYTHON)
  list(APPEND python_programs src/tools/constraint_sim_sweep src/tools/spawn)
endif()
catkin_install_python(PROGRAMS ${python_programs} DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
install(FILES src/tools/run_statistics.py DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
