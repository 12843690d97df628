# With ROS `make run_tests` runs all tests, without it ctest does; scripts/test reads
# registered_tests.txt, one `kind<tab>name<tab>path` a line.

enable_testing()
set(registered_tests)

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

# A gtest program that is run as a test.
function(constraint_sim_add_gtest name)
  if(CONSTRAINT_SIM_ROS)
    catkin_add_gtest(${name} test/gtest_main.cpp ${ARGN})
  else()
    add_executable(${name} test/gtest_main.cpp ${ARGN})
    target_link_libraries(${name} ${GTEST_LIBRARIES} Threads::Threads)
    add_test(NAME ${name} COMMAND ${name})
  endif()
  constraint_sim_own_code(${name})
  target_compile_options(${name} PRIVATE -O1)  # a third less to build; what is tested is not in here
  if(CONSTRAINT_SIM_SANITIZE)
    # Half the time to build. The engine's own files are checked for these as well.
    target_compile_options(${name} PRIVATE -fno-sanitize=null,alignment)
    # Ten times slower: long tests take a part of their steps and scenes.
    target_compile_definitions(${name} PRIVATE CONSTRAINT_SIM_SANITIZED)
  endif()
  target_include_directories(${name} PRIVATE ${test_paths})
  set(registered_tests ${registered_tests} "gtest\t${name}\t$<TARGET_FILE:${name}>" PARENT_SCOPE)
endfunction()

if(CONSTRAINT_SIM_ROS)
  find_package(rostest REQUIRED)
else()
  find_package(GTest REQUIRED)
endif()
file(GLOB engine_tests CONFIGURE_DEPENDS test/engine/*.cpp)
if(CONSTRAINT_SIM_SANITIZE STREQUAL "thread")
  # what runs on one thread alone has nothing that this sanitizer could find
  foreach(path IN LISTS engine_tests)
    file(STRINGS ${path} uses_threads REGEX "threads|std::thread" LIMIT_COUNT 1)
    if(path MATCHES "/test_[^/]*$" AND NOT uses_threads)
      list(REMOVE_ITEM engine_tests ${path})
    endif()
  endforeach()
endif()
file(GLOB sim_tests CONFIGURE_DEPENDS test/sim/*.cpp)

constraint_sim_add_gtest(engine_tests ${engine_tests})
target_include_directories(engine_tests PRIVATE bench)  # problems.h
target_link_libraries(engine_tests constraint_sim_engine nlohmann_json::nlohmann_json)
add_dependencies(engine_tests constraint_sim_run)

constraint_sim_add_gtest(sim_tests ${sim_tests})
target_link_libraries(sim_tests constraint_sim_stepper)

if(TARGET constraint_sim_urdf)
  file(GLOB urdf_tests CONFIGURE_DEPENDS test/urdf/*.cpp)
  constraint_sim_add_gtest(urdf_tests ${urdf_tests})
  target_include_directories(urdf_tests PRIVATE bench test/engine)  # support.h
  target_link_libraries(urdf_tests constraint_sim_urdf constraint_sim_stepper)
endif()

constraint_sim_add_gtest(report_tests test/report/test_report.cpp)
target_include_directories(report_tests PRIVATE bench)
target_link_libraries(report_tests constraint_sim_report_common constraint_sim_engine)
add_dependencies(report_tests constraint_sim_report_engine)

if(CONSTRAINT_SIM_ROS)
  constraint_sim_add_gtest(conversions_test test/ros/test_conversions.cpp)
  target_link_libraries(conversions_test constraint_sim_ros)

  constraint_sim_add_gtest(markers_test test/ros/test_markers.cpp
    test/engine/counted_allocations.cpp)
  target_include_directories(markers_test PRIVATE test/engine)
  target_link_libraries(markers_test constraint_sim_ros)

  if(TARGET constraint_sim_panel)
    constraint_sim_add_gtest(panel_test test/ros/test_motors.cpp src/panel/motors.cpp)
    target_link_libraries(panel_test constraint_sim_engine yaml-cpp)
  endif()

  file(GLOB ros_tests CONFIGURE_DEPENDS test/ros/*.test)
  if(NOT dynamic_reconfigure_FOUND)
    list(FILTER ros_tests EXCLUDE REGEX "/reconfigure\\.test$")
  endif()
  foreach(ros_test IN LISTS ros_tests)
    get_filename_component(name ${ros_test} NAME_WE)
    add_rostest(test/ros/${name}.test DEPENDENCIES constraint_sim_node)
    list(APPEND registered_tests "rostest\t${name}\t${ros_test}")
  endforeach()
endif()

if(TARGET constraint_sim_python)
  file(GLOB python_tests CONFIGURE_DEPENDS test/python/test_*.py)
  foreach(python_test IN LISTS python_tests)
    get_filename_component(name ${python_test} NAME_WE)
    set(command ${CMAKE_CURRENT_SOURCE_DIR}/scripts/run_python_test ${CMAKE_CURRENT_BINARY_DIR}
      ${python_test})
    if(CONSTRAINT_SIM_ROS)
      string(REPLACE ";" " " command "${command}")
      catkin_run_tests_target("python" ${name} "python-${name}.xml"
        COMMAND "${command} --junitxml=${CATKIN_TEST_RESULTS_DIR}/${PROJECT_NAME}/python-${name}.xml"
        DEPENDENCIES constraint_sim_python constraint_sim_run constraint_sim_report_engine)
    else()
      add_test(NAME ${name} COMMAND ${command})
    endif()
    list(APPEND registered_tests "python\t${name}\t${python_test}")
  endforeach()
endif()

string(REPLACE ";" "\n" registered_tests "${registered_tests}")
file(GENERATE OUTPUT ${CMAKE_CURRENT_BINARY_DIR}/registered_tests.txt
  CONTENT "${registered_tests}\n")

# Fails on purpose and is no test: scripts/test shows with it that a failure would be seen.
add_executable(failing_test EXCLUDE_FROM_ALL test/gtest_main.cpp test/selfcheck/failing_test.cpp)
target_link_libraries(failing_test ${GTEST_LIBRARIES} Threads::Threads)
constraint_sim_own_code(failing_test)
