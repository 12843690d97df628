#include "runner/robot.h"

#include <filesystem>
#ifdef CONSTRAINT_SIM_URDF
#include <cstdio>

#include "engine/support/files.h"
#include "urdf/robot.h"
#endif
#include <stdexcept>

namespace constraint_sim::engine {
namespace {

/// Returns the path of the file beside a URDF; empty where there is none.
std::string path_beside(const std::filesystem::path& urdf, const char* ending) {
  std::filesystem::path beside = urdf;
  beside.replace_extension(ending);
  std::error_code error;
  return std::filesystem::is_regular_file(beside, error) ? beside.string() : "";
}

#ifdef CONSTRAINT_SIM_URDF
std::string text_beside(const std::filesystem::path& urdf, const char* ending) {
  const std::string path = path_beside(urdf, ending);
  return path.empty() ? "" : read_file(path);
}
#endif

}  // namespace

bool is_xml(const std::string& text) {
  const std::size_t start = text.find_first_not_of(" \t\r\n");
  return start != std::string::npos && text[start] == '<' &&
         text.compare(start, 2, "<<") != 0;  // a merge key of YAML
}

std::vector<std::string> files_beside(const std::string& urdf, const RobotArguments& arguments) {
  std::vector<std::string> files{path_beside(urdf, ".srdf")};
  if (arguments.extra.empty()) files.push_back(path_beside(urdf, ".yaml"));
  return files;
}

#ifdef CONSTRAINT_SIM_URDF

World load_robot(const std::string& text, const std::string& path,
                 const RobotArguments& arguments) {
  RobotOptions options;
  options.fixed = arguments.fixed;
  options.pose.position.z() = arguments.z;
  options.how_to_expand = "`xacro FILE > expanded.urdf` expands it";
  if (!path.empty()) {
    const std::filesystem::path file = std::filesystem::absolute(path);
    options.folder = file.parent_path().string();
    options.srdf = text_beside(file, ".srdf");
    if (arguments.extra.empty()) options.extra = text_beside(file, ".yaml");
  }
  if (!arguments.extra.empty()) options.extra = read_file(arguments.extra);
  World world;
  const Robot robot = add_robot(text, options, &world);
  for (const std::string& warning : robot.warnings)
    std::fprintf(stderr, "constraint_sim_run: robot %s: %s\n", robot.name.c_str(), warning.c_str());
  return world;
}

#else

World load_robot(const std::string& /*text*/, const std::string& path,
                 const RobotArguments& /*arguments*/) {
  throw std::invalid_argument((path.empty() ? "standard input" : path) +
                              ": is XML; this program was built without urdfdom, which reads "
                              "URDFs");
}

#endif

}  // namespace constraint_sim::engine
