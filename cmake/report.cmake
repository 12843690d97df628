# bench/report: what all programs share, and constraint_sim_report_<name> for each peers/<name>.cpp.
# The first line of a peer's file says what it needs: `// needs: pkg-config NAME` or
# `// needs: library NAME`. A program whose library is missing is left out.

option(CONSTRAINT_SIM_PEERS "Build the report's programs for other engines that are installed" OFF)
find_package(PkgConfig QUIET)

file(GLOB problem_sources CONFIGURE_DEPENDS bench/report/problems/*.cpp)
add_library(constraint_sim_report_common OBJECT EXCLUDE_FROM_ALL
  bench/report/judge.cpp
  bench/report/measures.cpp
  bench/report/phases.cpp
  bench/report/problem.cpp
  bench/report/references.cpp
  bench/report/scene_problem.cpp
  bench/report/tree.cpp
  ${problem_sources}
)
target_include_directories(constraint_sim_report_common PUBLIC bench)  # problems.h, rotation_between.h
constraint_sim_precompile(constraint_sim_report_common ${common_headers})
add_library(constraint_sim_report_main OBJECT EXCLUDE_FROM_ALL bench/report/main.cpp)
add_library(constraint_sim_report_ours OBJECT EXCLUDE_FROM_ALL bench/report/peers/engine.cpp)
foreach(library common main ours)
  constraint_sim_own_code(constraint_sim_report_${library})
  target_link_libraries(constraint_sim_report_${library} PUBLIC constraint_sim_engine)
endforeach()

# Includes of other engines are not ours to warn about.
function(constraint_sim_add_report name)
  add_executable(constraint_sim_report_${name} EXCLUDE_FROM_ALL bench/report/peers/${name}.cpp)
  constraint_sim_own_code(constraint_sim_report_${name})
  target_link_libraries(constraint_sim_report_${name} PRIVATE constraint_sim_report_main
    constraint_sim_report_common constraint_sim_engine Boost::program_options ${ARGN})
  # warned about where code of other engines is inlined into ours
  target_compile_options(constraint_sim_report_${name} PRIVATE -Wno-array-bounds)
  set(report_programs ${report_programs} constraint_sim_report_${name} PARENT_SCOPE)
endfunction()

execute_process(COMMAND git -C ${CMAKE_CURRENT_SOURCE_DIR} describe --always --dirty
  OUTPUT_VARIABLE commit OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
if(NOT commit)
  set(commit "${PROJECT_VERSION}")
endif()

set_source_files_properties(bench/report/peers/engine.cpp PROPERTIES
  COMPILE_DEFINITIONS "CONSTRAINT_SIM_COMMIT=\"${commit}\"")

# Debian builds Simbody with asserts, and its headers have other members with them.
set_source_files_properties(bench/report/peers/simbody.cpp PROPERTIES COMPILE_OPTIONS -UNDEBUG)

add_executable(constraint_sim_report_engine EXCLUDE_FROM_ALL $<TARGET_OBJECTS:constraint_sim_report_ours>)
target_link_libraries(constraint_sim_report_engine PRIVATE constraint_sim_report_main
  constraint_sim_report_common constraint_sim_engine Boost::program_options)

set(report_programs constraint_sim_report_engine)
file(GLOB peer_sources CONFIGURE_DEPENDS bench/report/peers/*.cpp)
foreach(source IN LISTS peer_sources)
  get_filename_component(name ${source} NAME_WE)
  file(STRINGS ${source} needs LIMIT_COUNT 1 REGEX "^// needs: ")
  if(name STREQUAL engine OR NOT CONSTRAINT_SIM_PEERS)
    continue()
  elseif(needs MATCHES "pkg-config ([^ ]+)")
    if(PKG_CONFIG_FOUND)
      pkg_check_modules(${name} QUIET ${CMAKE_MATCH_1})
    endif()
    if(${name}_FOUND)
      constraint_sim_add_report(${name} ${${name}_LINK_LIBRARIES})
      target_include_directories(constraint_sim_report_${name} SYSTEM PRIVATE ${${name}_INCLUDE_DIRS})
      set(flags ${${name}_CFLAGS_OTHER})
      list(FILTER flags EXCLUDE REGEX "^-std=")
      target_compile_options(constraint_sim_report_${name} PRIVATE ${flags})
      target_compile_definitions(constraint_sim_report_${name} PRIVATE
        CONSTRAINT_SIM_PEER_VERSION="${${name}_VERSION}")
    endif()
  elseif(needs MATCHES "library ([^ ]+)")
    find_library(${name}_LIBRARY ${CMAKE_MATCH_1})
    if(${name}_LIBRARY)
      constraint_sim_add_report(${name} ${${name}_LIBRARY})
    endif()
  endif()
endforeach()

# what scripts/report builds
add_custom_target(report_programs DEPENDS ${report_programs})
if(benchmark_FOUND)
  constraint_sim_add_benchmark(constraint_sim_micro bench/report/micro.cpp constraint_sim_report_ours
    constraint_sim_report_common constraint_sim_engine benchmark::benchmark)
  add_dependencies(report_programs constraint_sim_micro)
else()
  message(STATUS "Google Benchmark is not there: constraint_sim_micro is left out")
endif()

# ODE's contact of two boxes beside ours
if(TARGET constraint_sim_box_box AND TARGET constraint_sim_report_ode)
  target_include_directories(constraint_sim_box_box SYSTEM PRIVATE ${ode_INCLUDE_DIRS})
  target_compile_options(constraint_sim_box_box PRIVATE ${ode_CFLAGS_OTHER})
  target_compile_definitions(constraint_sim_box_box PRIVATE CONSTRAINT_SIM_BENCH_ODE)
  target_link_libraries(constraint_sim_box_box PRIVATE ${ode_LINK_LIBRARIES})
endif()
