# Installation without ROS: find_package(constraint_sim) gives constraint_sim::engine.

include(CMakePackageConfigHelpers)
include(GNUInstallDirs)

set(config_dir ${CMAKE_INSTALL_LIBDIR}/cmake/constraint_sim)
install(TARGETS constraint_sim_engine EXPORT constraint_sim
  ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
install(TARGETS constraint_sim_run constraint_sim_error_table RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
install(DIRECTORY include/constraint_sim DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
install(DIRECTORY config DESTINATION ${CMAKE_INSTALL_DATADIR}/constraint_sim)
install(EXPORT constraint_sim NAMESPACE constraint_sim:: FILE constraint_simTargets.cmake
  DESTINATION ${config_dir})
configure_package_config_file(cmake/constraint_simConfig.cmake.in constraint_simConfig.cmake
  INSTALL_DESTINATION ${config_dir})
write_basic_package_version_file(constraint_simConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES
  ${CMAKE_CURRENT_BINARY_DIR}/constraint_simConfig.cmake
  ${CMAKE_CURRENT_BINARY_DIR}/constraint_simConfigVersion.cmake
  DESTINATION ${config_dir}
)
