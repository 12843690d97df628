#include "runner/arguments.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <limits>
#include <sstream>
#include <type_traits>

#include "constraint_sim/engine/scene.h"
#include "constraint_sim/engine/snapshot.h"
#include "engine/model/method_names.h"
#include "engine/model/option_values.h"
#include "engine/model/validate.h"
#include "engine/support/files.h"

namespace constraint_sim::engine {
namespace {

/// Returns the folder of the program's own scenes, in its installation or in its sources.
std::string scene_folder() {
  namespace fs = std::filesystem;
  std::error_code no_link;
  const fs::path folder = fs::read_symlink("/proc/self/exe", no_link).parent_path();
  for (const char* prefix : {"..", "../.."}) {  // PREFIX/bin, and catkin's PREFIX/lib/PACKAGE
    const fs::path scenes = folder / prefix / "share/constraint_sim/config/scenes";
    std::error_code error;
    if (!no_link && fs::is_directory(scenes, error)) return fs::weakly_canonical(scenes, error);
  }
  return CONSTRAINT_SIM_SOURCE_SCENES;
}

/// Returns the first bytes of a file; empty where it is no regular file.
std::string start_of(const std::string& path) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) return "";
  std::ifstream file(path, std::ios::binary);
  std::string bytes(256, '\0');
  file.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  return bytes;
}

/// Loads a scene, a snapshot or a URDF from a file, a scene by its name, or `-`: standard input.
World load_scene_named(const std::string& scene, const RobotArguments& robot) {
  const auto without_robot = [&](World world) {
    if (robot.fixed || robot.z != 0.0 || !robot.extra.empty())
      refuse("robot-fixed, robot-z, robot-extra",
             "are for URDFs, and " + in_quotes(scene) + " is none");
    return world;
  };
  if (scene != "-") {
    const std::string path = file_of_scene(scene, scene_folder());
    const std::string start = start_of(path);
    if (is_xml(start)) return load_robot(read_file(path), path, robot);
    if (!is_snapshot(start)) return without_robot(load_scene_file(path));
    std::ifstream file(path, std::ios::binary);
    return without_robot(read_snapshot({std::istreambuf_iterator<char>(file), {}}));
  }
  std::string text(kMostSceneBytes + 1, '\0');
  std::cin.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(std::cin.gcount()));
  if (is_xml(text)) return load_robot(text, "", robot);
  return without_robot(load_scene(text, "standard input"));
}

/// A number, or `.inf` as in scenes.
struct NumberOrInfinity {
  double value = 0.0;
};

std::istream& operator>>(std::istream& in, NumberOrInfinity& number) {
  std::string word;
  in >> word;
  std::istringstream text(word);
  if (word == ".inf")
    number.value = std::numeric_limits<double>::infinity();
  else if (!(text >> number.value) || text.peek() != std::istringstream::traits_type::eof())
    in.setstate(std::ios::failbit);
  return in;
}

/// Type of the command line argument for an option of the world; void: no argument.
template <class Value, class Range>
struct Argument {
  using Type = Value;
};
template <class Range>
struct Argument<Eigen::Vector3d, Range> {
  using Type = void;
};
template <>
struct Argument<double, PositiveOrInfinity> {
  using Type = NumberOrInfinity;
};
template <>
struct Argument<Method, AnyValue> {
  using Type = std::string;
};

template <class Value>
Value value_of(const Value& argument) {
  return argument;
}
double value_of(const NumberOrInfinity& argument) { return argument.value; }
Method value_of(const std::string& argument) { return method_named(argument); }

/// Calls visit(argument name, OptionInfo, member of `options`, range, null pointer of the
/// argument's type) for each option with a command line argument.
template <class Visit>
void visit_arguments(WorldOptions* options, Visit visit) {
  visit_options(*options, [&](const OptionInfo& info, auto& value, auto range) {
    using Type = typename Argument<std::decay_t<decltype(value)>, decltype(range)>::Type;
    if constexpr (!std::is_void_v<Type>) {
      std::string argument = info.name;
      std::replace(argument.begin(), argument.end(), '_', '-');
      visit(argument, info, value, range, static_cast<const Type*>(nullptr));
    }
  });
}

}  // namespace

std::optional<Arguments> parse(int argc, char** argv) {
  namespace po = boost::program_options;
  Arguments arguments;
  po::options_description visible("Options");
  auto add = visible.add_options();
  add("help,h", "print this");
  add("duration", po::value(&arguments.duration)->required()->value_name("SECONDS"),
      "simulated time to run, to the nearest tick");
  add("csv", po::value(&arguments.csv)->value_name("FILE"),
      "write the state of each body, at the start and after every step");
  add("constraint-csv", po::value(&arguments.constraint_csv)->value_name("FILE"),
      "write coordinates, error, force and torque of each constraint, as --csv");
  add("report", po::value(&arguments.report)->value_name("FILE"), "write the outcome as JSON");
  add("save", po::value(&arguments.save)->value_name("FILE"), "write the final state as a scene");
  add("snapshot", po::value(&arguments.snapshot)->value_name("FILE"),
      "write the final state to the bit, to go on from with this program as SCENE");
  add("explain", po::bool_switch(&arguments.explain),
      "print what the scene uses and what is left out, as YAML");
  add("verify", po::bool_switch(&arguments.verify),
      "run again with half the time step, by another method and from a perturbed state, and "
      "compare the differences of each body with its error estimate");
  po::options_description of_robot("A robot, where SCENE is a URDF");
  auto add_of_robot = of_robot.add_options();
  add_of_robot("robot-fixed", po::bool_switch(&arguments.robot.fixed), "the root does not move");
  add_of_robot("robot-z", po::value(&arguments.robot.z)->value_name("METRES"),
               "[m] height of the root");
  add_of_robot("robot-extra", po::value(&arguments.robot.extra)->value_name("FILE"),
               "YAML with motors and positions, in place of the one beside the URDF");
  po::options_description of_world("Options of the world, in place of the scene's");
  auto add_of_world = of_world.add_options();
  WorldOptions defaults;
  visit_arguments(&defaults, [&](const std::string& argument, const OptionInfo& info,
                                 const auto& value, auto range, const auto* as) {
    using Type = std::decay_t<decltype(*as)>;
    const std::string unit = *info.unit == '\0' ? "" : "[" + std::string(info.unit) + "] ";
    add_of_world(argument.c_str(), po::value<Type>()->value_name("VALUE"),
                 (unit + range_and_meaning(info, value, range)).c_str());
  });
  po::options_description all;
  all.add(visible).add(of_robot).add(of_world).add_options()(
      "scene", po::value(&arguments.scene)->required());
  po::positional_options_description positions;
  positions.add("scene", 1);

  po::variables_map values;
  const int style = po::command_line_style::unix_style & ~po::command_line_style::allow_guessing;
  po::store(
      po::command_line_parser(argc, argv).options(all).positional(positions).style(style).run(),
      values);
  if (values.count("help") > 0) {
    std::cout << "Usage: constraint_sim_run SCENE --duration SECONDS [options]\n\n"
              << "SCENE is a file (a scene, a snapshot or a URDF), `-` for standard input, or one "
                 "of those "
                 "that\ncome with this:\n";
    for (const std::string& name : scene_names(scene_folder())) std::cout << "  " << name << '\n';
    std::cout
        << '\n'
        << visible << '\n'
        << of_robot << '\n'
        << of_world
        << "\nExit status: 0, 2 for bad input, 3 when the physics failed, 4 when it finished but\n"
           "an error was not closed, energy rose without a cause or --verify found a\n"
           "difference that the estimate does not explain, 130 or 143 when interrupted or\n"
           "terminated: the files are written as far as it came.\n";
    return std::nullopt;
  }
  po::notify(values);
  arguments.options = values;
  return arguments;
}

std::vector<std::pair<std::string, std::string>> files_read(const Arguments& arguments) {
  const RobotArguments& robot = arguments.robot;
  if (arguments.scene == "-") return {{"--robot-extra", robot.extra}};
  const std::string path = file_of_scene(arguments.scene, scene_folder());
  std::vector<std::pair<std::string, std::string>> files{{"the scene", path},
                                                         {"--robot-extra", robot.extra}};
  if (is_xml(start_of(path)))
    for (const std::string& beside : files_beside(path, robot))
      files.emplace_back("the robot", beside);
  return files;
}

World load(const Arguments& arguments) {
  World world = load_scene_named(arguments.scene, arguments.robot);
  WorldOptions options = world.options();
  bool any = false;
  visit_arguments(&options, [&](const std::string& argument, const OptionInfo&, auto& value, auto,
                                const auto* as) {
    if (arguments.options.count(argument) == 0) return;
    value = value_of(arguments.options[argument].as<std::decay_t<decltype(*as)>>());
    any = true;
  });
  if (any) world.set_options(options);
  return world;
}

}  // namespace constraint_sim::engine
