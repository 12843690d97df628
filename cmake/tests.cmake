# The tests, each of them one of CTest: `ctest -L engine`, `ctest -R contact_events` in the build folder.
# Labels: engine, sim, urdf, report, fcl (gtest programs), ros, rviz (rostest), python (pytest).
# The target `tests` builds what they run; with catkin_make `run_tests` runs them all.

enable_testing()
if(NOT TARGET tests)
  add_custom_target(tests)
endif()
if(CONSTRAINT_SIM_ROS)
  find_package(rostest REQUIRED)
  set(test_results ${CATKIN_TEST_RESULTS_DIR}/${PROJECT_NAME})
else()
  find_package(GTest REQUIRED)
  set(test_results ${CMAKE_CURRENT_BINARY_DIR}/test_results)
endif()

# Where tests find things, in a header for those that ask: for all others the compiler's command is
# the same in every folder, and ccache knows them.
set(test_paths ${CMAKE_CURRENT_BINARY_DIR}/test_paths)
file(GENERATE OUTPUT ${test_paths}/test_paths.h CONTENT "#pragma once
#define CONSTRAINT_SIM_SOURCE_DIR \"${CMAKE_CURRENT_SOURCE_DIR}\"
#define CONSTRAINT_SIM_SCENE_DIR CONSTRAINT_SIM_SOURCE_DIR \"/config/scenes\"
#define CONSTRAINT_SIM_ROBOT_DIR CONSTRAINT_SIM_SOURCE_DIR \"/config/robots\"
#define CONSTRAINT_SIM_RUN \"$<TARGET_FILE:constraint_sim_run>\"
#define CONSTRAINT_SIM_REPORT \"$<TARGET_FILE:constraint_sim_report_engine>\"
")

# ---- gtest programs

function(constraint_sim_add_gtest_program name)
  add_executable(${name} EXCLUDE_FROM_ALL test/gtest_main.cpp ${ARGN})
  target_link_libraries(${name} PRIVATE ${GTEST_LIBRARIES} Threads::Threads)
  target_include_directories(${name} PRIVATE ${GTEST_INCLUDE_DIRS} ${test_paths})
  constraint_sim_own_code(${name})
  target_compile_options(${name} PRIVATE -O1)  # a third less to build; what is tested is not in here
  if(CONSTRAINT_SIM_SANITIZE)
    # Half the time to build. The engine's own files are checked for these as well.
    target_compile_options(${name} PRIVATE -fno-sanitize=null,alignment)
    # Ten times slower: long tests take a part of their steps and scenes.
    target_compile_definitions(${name} PRIVATE CONSTRAINT_SIM_SANITIZED)
  endif()
  add_dependencies(tests ${name})
endfunction()

# The program `name` as one CTest test for each file in ARGN, with the suites that the file defines:
# `label.contact_events` of test_contact_events.cpp. A first line `// shards: N` makes N tests of a long
# file, which run side by side.
function(constraint_sim_add_gtests name label)
  foreach(path IN LISTS ARGN)
    get_filename_component(file ${path} NAME_WE)
    string(REGEX REPLACE "^test_" "" file ${file})
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${path})
    file(STRINGS ${path} defined REGEX "^(TYPED_)?TEST(_F|_P)?\\(")
    set(suites)
    foreach(line IN LISTS defined)
      string(REGEX REPLACE "^[A-Z_]+\\(([A-Za-z0-9_]+).*" "\\1" suite "${line}")
      list(APPEND suites ${suite})
    endforeach()
    if(NOT suites)
      continue()
    endif()
    list(REMOVE_DUPLICATES suites)
    set(filter)
    foreach(suite IN LISTS suites)
      set(filter "${filter}:${suite}.*:${suite}/*:*/${suite}.*:*/${suite}/*")
    endforeach()
    string(SUBSTRING "${filter}" 1 -1 filter)
    file(STRINGS ${path} shards LIMIT_COUNT 1 REGEX "^// shards: ")
    string(REGEX REPLACE "[^0-9]" "" shards "${shards}")
    if(NOT shards)
      set(shards 1)
    endif()
    foreach(shard RANGE 1 ${shards})
      set(test ${label}.${file})
      if(shards GREATER 1)
        set(test ${test}.${shard}_of_${shards})
      endif()
      math(EXPR index "${shard} - 1")
      add_test(NAME ${test} COMMAND ${in_space} $<TARGET_FILE:${name}> "--gtest_filter=${filter}"
        "--gtest_output=xml:${test_results}/${test}.xml")
      set_tests_properties(${test} PROPERTIES LABELS ${label} TIMEOUT 1500 COST ${shards}
        ENVIRONMENT "GTEST_TOTAL_SHARDS=${shards};GTEST_SHARD_INDEX=${index};TSAN_OPTIONS=suppressions='${CMAKE_CURRENT_SOURCE_DIR}/test/thread_sanitizer.supp'")
    endforeach()
  endforeach()
endfunction()

file(GLOB engine_sources CONFIGURE_DEPENDS test/engine/*.cpp)
file(GLOB sim_tests CONFIGURE_DEPENDS test/sim/*.cpp)
if(CONSTRAINT_SIM_SANITIZE STREQUAL "thread")
  # what runs on one thread alone has nothing that this sanitizer could find
  foreach(path IN LISTS engine_sources)
    file(STRINGS ${path} uses_threads REGEX "threads|std::thread" LIMIT_COUNT 1)
    if(path MATCHES "/test_[^/]*$" AND NOT uses_threads)
      list(REMOVE_ITEM engine_sources ${path})
    endif()
  endforeach()
endif()

constraint_sim_add_gtest_program(engine_tests ${engine_sources})
target_include_directories(engine_tests PRIVATE bench)  # problems.h
target_link_libraries(engine_tests PRIVATE constraint_sim_engine nlohmann_json::nlohmann_json)
constraint_sim_precompile(engine_tests <gtest/gtest.h> <Eigen/Dense> <functional> <map> <sstream>
  <constraint_sim/engine/scene.h> <constraint_sim/engine/plan.h> <constraint_sim/engine/world.h>)
set(engine_units ${engine_sources})
list(FILTER engine_units EXCLUDE REGEX "/counted_allocations\\.cpp$")  # compilers must not see operator new
constraint_sim_units(engine_tests 5 ${engine_units})
add_dependencies(engine_tests constraint_sim_run)
constraint_sim_add_gtests(engine_tests engine ${engine_sources})

constraint_sim_add_gtest_program(sim_tests ${sim_tests})
target_link_libraries(sim_tests PRIVATE constraint_sim_stepper)
constraint_sim_units(sim_tests 4 ${sim_tests})
constraint_sim_add_gtests(sim_tests sim ${sim_tests})

if(TARGET constraint_sim_urdf)
  file(GLOB urdf_tests CONFIGURE_DEPENDS test/urdf/*.cpp)
  constraint_sim_add_gtest_program(urdf_tests ${urdf_tests})
  target_include_directories(urdf_tests PRIVATE bench test/engine)  # support.h
  target_link_libraries(urdf_tests PRIVATE constraint_sim_urdf constraint_sim_stepper)
  add_dependencies(urdf_tests constraint_sim_run)
  constraint_sim_units(urdf_tests 2 ${urdf_tests})
  constraint_sim_add_gtests(urdf_tests urdf ${urdf_tests})
endif()

set(report_tests test/report/test_random.cpp test/report/test_report.cpp)
constraint_sim_add_gtest_program(report_tests ${report_tests})
target_include_directories(report_tests PRIVATE bench test/engine)  # temporary_folder.h
target_link_libraries(report_tests PRIVATE constraint_sim_report_common constraint_sim_engine)
add_dependencies(report_tests constraint_sim_report_engine)
constraint_sim_add_gtests(report_tests report ${report_tests})

# Shapes against another library, whose interface changed with 0.6 (Ubuntu 20.04 has 0.5).
find_package(fcl 0.6 QUIET)
if(fcl_FOUND)
  constraint_sim_add_gtest_program(fcl_tests test/fcl/test_fcl.cpp)
  target_include_directories(fcl_tests PRIVATE bench test/engine)  # draw.h, sanitized.h
  target_link_libraries(fcl_tests PRIVATE constraint_sim_engine fcl)
  constraint_sim_add_gtests(fcl_tests fcl test/fcl/test_fcl.cpp)
else()
  message(STATUS "shapes are not compared with FCL: FCL 0.6 or later is not installed")
endif()

# ---- rostest

if(CONSTRAINT_SIM_ROS)
  constraint_sim_add_gtest_program(ros_tests
    test/ros/test_body_meshes.cpp test/ros/test_conversions.cpp test/ros/test_markers.cpp
    test/engine/counted_allocations.cpp)
  target_include_directories(ros_tests PRIVATE test/engine)
  target_link_libraries(ros_tests PRIVATE constraint_sim_ros)
  constraint_sim_units(ros_tests 3
    test/ros/test_body_meshes.cpp test/ros/test_conversions.cpp test/ros/test_markers.cpp)
  # shipped scenes are found as files of the package
  set(in_space ${CMAKE_CURRENT_SOURCE_DIR}/scripts/run_in_space
    "${CMAKE_INSTALL_PREFIX}:${CATKIN_DEVEL_PREFIX}")
  constraint_sim_add_gtests(ros_tests ros_shell
    test/ros/test_body_meshes.cpp test/ros/test_conversions.cpp test/ros/test_markers.cpp)
  set(in_space)

  if(TARGET constraint_sim_panel)
    constraint_sim_add_gtest_program(panel_tests test/ros/test_motors.cpp src/panel/motors.cpp)
    target_link_libraries(panel_tests PRIVATE constraint_sim_engine yaml-cpp)
    constraint_sim_add_gtests(panel_tests panel test/ros/test_motors.cpp)
    # shows the panel as rviz loads it, without rviz
    add_executable(panel_fields EXCLUDE_FROM_ALL test/ros/panel_fields.cpp)
    constraint_sim_own_code(panel_fields)
    target_compile_definitions(panel_fields PRIVATE QT_NO_KEYWORDS)
    target_include_directories(panel_fields SYSTEM PRIVATE ${rviz_INCLUDE_DIRS} ${catkin_INCLUDE_DIRS})
    target_link_libraries(panel_fields PRIVATE ${rviz_LIBRARIES} ${catkin_LIBRARIES} Qt5::Widgets ${CMAKE_DL_LIBS})
    add_dependencies(tests panel_fields)
  endif()

  file(GLOB ros_tests CONFIGURE_DEPENDS test/ros/*.test)
  if(NOT dynamic_reconfigure_FOUND)
    list(FILTER ros_tests EXCLUDE REGEX "/reconfigure\\.test$")
  endif()
  foreach(ros_test IN LISTS ros_tests)
    get_filename_component(name ${ros_test} NAME_WE)
    add_test(NAME ros.${name} COMMAND ${CMAKE_CURRENT_SOURCE_DIR}/scripts/run_ros_test
      "${CMAKE_INSTALL_PREFIX}:${CATKIN_DEVEL_PREFIX}" ${ros_test} ${test_results}/ros.${name})
    set_tests_properties(ros.${name} PROPERTIES LABELS ros TIMEOUT 600 COST 10)
    # a first line `<!-- rviz -->` marks a test that looks at rviz
    file(STRINGS ${ros_test} first LIMIT_COUNT 1)
    if(first MATCHES "rviz")
      set_tests_properties(ros.${name} PROPERTIES LABELS "ros;rviz" TIMEOUT 1200 COST 20)
    endif()
    if(name STREQUAL "panel_names" AND TARGET panel_fields)
      set_tests_properties(ros.${name} PROPERTIES ENVIRONMENT "PANEL_FIELDS=$<TARGET_FILE:panel_fields>")
    endif()
    if(first MATCHES "alone")
      set_tests_properties(ros.${name} PROPERTIES RUN_SERIAL ON)
    endif()
    # `<!-- 130 s -->` is about how long a test takes, most of which it waits: CTest starts the longest first
    if(first MATCHES "([0-9]+) s ")
      set_tests_properties(ros.${name} PROPERTIES COST ${CMAKE_MATCH_1})
    endif()
  endforeach()

  # what CTest runs is what catkin_make runs
  add_custom_target(run_ctest COMMAND ${CMAKE_CTEST_COMMAND} --output-on-failure
    WORKING_DIRECTORY ${CMAKE_CURRENT_BINARY_DIR})
  add_dependencies(run_ctest tests)
  add_dependencies(run_tests run_ctest)
  add_dependencies(tests constraint_sim_node)
endif()

# ---- pytest

if(TARGET constraint_sim_python)
  add_dependencies(tests constraint_sim_python constraint_sim_run constraint_sim_report_engine)
  file(GLOB python_tests CONFIGURE_DEPENDS test/python/test_*.py)
  if(NOT CONSTRAINT_SIM_ROS)
    list(FILTER python_tests EXCLUDE REGEX "/test_interfaces\\.py$")
  endif()
  foreach(python_test IN LISTS python_tests)
    get_filename_component(name ${python_test} NAME_WE)
    string(REGEX REPLACE "^test_" "" name ${name})
    add_test(NAME python.${name} COMMAND ${CMAKE_CURRENT_SOURCE_DIR}/scripts/run_python_test
      ${CMAKE_CURRENT_BINARY_DIR} ${python_test} --junitxml=${test_results}/python.${name}.xml)
    set_tests_properties(python.${name} PROPERTIES LABELS python TIMEOUT 600 COST 15)
    if(CONSTRAINT_SIM_ROS)
      set_tests_properties(python.${name} PROPERTIES
        ENVIRONMENT "CONSTRAINT_SIM_SPACES=${CMAKE_INSTALL_PREFIX}:${CATKIN_DEVEL_PREFIX}")
    endif()
  endforeach()
endif()
