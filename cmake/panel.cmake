# The panel of rviz, in a library of its own: nothing else links Qt. Without rviz or Qt 5 it is left out.

find_package(rviz QUIET)
find_package(Qt5 QUIET COMPONENTS Core Gui Widgets)
if(NOT rviz_FOUND OR NOT Qt5_FOUND)
  message(STATUS "rviz or Qt 5 is not there: its panel is left out")
  return()
endif()

# no class has signals of its own, so that there is nothing for moc
file(GLOB panel_sources RELATIVE ${CMAKE_CURRENT_SOURCE_DIR} CONFIGURE_DEPENDS src/panel/*.cpp)
add_library(constraint_sim_panel SHARED ${panel_sources})
constraint_sim_units(constraint_sim_panel 1000 ${panel_sources})
constraint_sim_shell_code(constraint_sim_panel)
add_dependencies(constraint_sim_panel ${PROJECT_NAME}_generate_messages_cpp)
# boost has functions named as Qt's keywords
target_compile_definitions(constraint_sim_panel PRIVATE QT_NO_KEYWORDS)
target_include_directories(constraint_sim_panel SYSTEM PRIVATE
  ${CATKIN_DEVEL_PREFIX}/${CATKIN_GLOBAL_INCLUDE_DESTINATION} ${rviz_INCLUDE_DIRS} ${catkin_INCLUDE_DIRS})
target_link_libraries(constraint_sim_panel PRIVATE ${rviz_LIBRARIES} ${catkin_LIBRARIES} yaml-cpp Qt5::Widgets ${CMAKE_DL_LIBS})
install(TARGETS constraint_sim_panel LIBRARY DESTINATION ${CATKIN_PACKAGE_LIB_DESTINATION})

add_executable(constraint_sim_panel_costs EXCLUDE_FROM_ALL
  bench/ros/panel_costs.cpp src/panel/motors.cpp src/panel/world_model.cpp)
constraint_sim_own_code(constraint_sim_panel_costs)
add_dependencies(constraint_sim_panel_costs ${PROJECT_NAME}_generate_messages_cpp)
target_compile_definitions(constraint_sim_panel_costs PRIVATE QT_NO_KEYWORDS)
target_include_directories(constraint_sim_panel_costs SYSTEM PRIVATE
  ${CATKIN_DEVEL_PREFIX}/${CATKIN_GLOBAL_INCLUDE_DESTINATION} ${catkin_INCLUDE_DIRS})
target_link_libraries(constraint_sim_panel_costs PRIVATE ${catkin_LIBRARIES} yaml-cpp Qt5::Widgets)
add_dependencies(benchmarks constraint_sim_panel_costs)
