# The Python module constraint_sim.engine, beside the Python files of python/constraint_sim. With catkin
# it lies in the package that holds the messages, so that both are imported in one process.

# the python3 that is first on PATH; left alone, FindPythonInterp prefers the oldest that it knows by name
find_program(PYTHON_EXECUTABLE python3)
if(Python3_FOUND)  # catkin has found the interpreter alone, and pybind11 relies on that result
  set(Python3_EXECUTABLE ${PYTHON_EXECUTABLE})
  find_package(Python3 REQUIRED COMPONENTS Interpreter Development)
endif()
find_package(pybind11 2.4 REQUIRED)
file(GLOB python_sources RELATIVE ${CMAKE_CURRENT_SOURCE_DIR} CONFIGURE_DEPENDS src/python/*.cpp)
pybind11_add_module(constraint_sim_python MODULE NO_EXTRAS ${python_sources})
constraint_sim_units(constraint_sim_python 8 ${python_sources})
constraint_sim_shell_code(constraint_sim_python)
# includes of others are not ours to warn about
target_include_directories(constraint_sim_python SYSTEM PRIVATE
  ${pybind11_INCLUDE_DIRS} ${PYTHON_INCLUDE_DIRS})
target_compile_definitions(constraint_sim_python PRIVATE
  CONSTRAINT_SIM_VERSION="${PROJECT_VERSION}")
target_link_libraries(constraint_sim_python PRIVATE constraint_sim_engine)
if(TARGET constraint_sim_urdf)
  target_compile_definitions(constraint_sim_python PRIVATE CONSTRAINT_SIM_URDF)
  target_link_libraries(constraint_sim_python PRIVATE constraint_sim_urdf)
endif()
set_target_properties(constraint_sim_python PROPERTIES OUTPUT_NAME engine)

# In devel space, or in BUILD/python: with the sources' python/ on PYTHONPATH as well, the package
# finds its module there.
if(CONSTRAINT_SIM_ROS)
  set(python_build_dir ${CATKIN_DEVEL_PREFIX}/${CATKIN_GLOBAL_PYTHON_DESTINATION})
  set(python_install_dir ${CATKIN_GLOBAL_PYTHON_DESTINATION})
else()
  set(python_build_dir ${CMAKE_CURRENT_BINARY_DIR}/python)
  set(python_install_dir lib/python3/dist-packages CACHE STRING "Where Python finds modules")
endif()
set_target_properties(constraint_sim_python PROPERTIES
  LIBRARY_OUTPUT_DIRECTORY ${python_build_dir}/constraint_sim)
install(TARGETS constraint_sim_python LIBRARY DESTINATION ${python_install_dir}/constraint_sim)
install(FILES python/constraint_sim/engine.pyi python/constraint_sim/py.typed
  DESTINATION ${python_install_dir}/constraint_sim)
if(NOT CONSTRAINT_SIM_ROS)  # with ROS setup.py installs them
  install(DIRECTORY python/constraint_sim DESTINATION ${python_install_dir}
    FILES_MATCHING PATTERN "*.py" PATTERN __pycache__ EXCLUDE)
  install(PROGRAMS src/tools/constraint_sim_sweep DESTINATION ${CMAKE_INSTALL_BINDIR})
endif()
