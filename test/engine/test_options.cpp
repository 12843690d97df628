// Options are listed once, by visit_options(): this test compares the struct, the engine's own uses
// and the manual with that list; test/python/test_engine.py compares Python's stubs.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <set>
#include <sstream>
#include <string>
#include <type_traits>
#include <vector>

#include "constraint_sim/engine/plan.h"
#include "constraint_sim/engine/scene.h"
#include "engine/model/option_values.h"
#include "engine/model/validate.h"
#include "support.h"
#include "test_paths.h"

namespace constraint_sim::engine {
namespace {

/// Changes a value within its range, for each type and range.
void change(Eigen::Vector3d* value, AnyValue) { *value += Eigen::Vector3d(0.5, 0.25, 1.0); }
void change(Method* value, AnyValue) { *value = Method::kSequentialImpulses; }
void change(bool* value, AnyValue) { *value = !*value; }
void change(int* value, EitherOf range) {
  *value = *value == range.first ? range.second : range.first;
}
void change(int* value, Count) { ++*value; }
template <class Range>
void change(double* value, Range) {
  *value = *value == 0.0 ? 0.5 : 0.5 * *value;
}

/// Returns, for each option, its name and the default options with only that option changed.
std::map<std::string, WorldOptions> changed_one_by_one() {
  std::map<std::string, WorldOptions> changed;
  const WorldOptions defaults;
  visit_options(defaults, [&](const OptionInfo& wanted, const auto&, auto) {
    WorldOptions options;
    visit_options(options, [&](const OptionInfo& info, auto& value, auto range) {
      if (std::string(info.name) == wanted.name) change(&value, range);
    });
    changed.emplace(wanted.name, options);
  });
  return changed;
}

/// Returns the text of an option's value in a scene.
std::string text_of(const WorldOptions& options, const std::string& name) {
  std::istringstream saved(save_scene(World(options)));
  const std::string key = name + ": ";
  for (std::string line; std::getline(saved, line);) {
    const std::size_t start = std::min(line.find_first_not_of(' '), line.size());
    if (line.compare(start, key.size(), key) == 0) return line.substr(start + key.size());
  }
  ADD_FAILURE() << name << " is not saved";
  return "";
}

/// Returns a scene that sets one option.
std::string scene_with(std::string name, const std::string& value) {
  return name.insert(0, "world: {").append(": ").append(value).append("}\n");
}

TEST(Options, AreAllListed) {
  // does not compile if the struct has another number of members
  const WorldOptions defaults;
  [[maybe_unused]] const auto& [a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p, q] = defaults;
  std::set<const void*> members;
  std::set<std::string> names;
  visit_options(defaults, [&](const OptionInfo& info, const auto& value, auto) {
    members.insert(&value);
    names.insert(info.name);
    EXPECT_STRNE(info.meaning, "") << info.name;
  });
  EXPECT_EQ(members.size(), 17u);
  EXPECT_EQ(names.size(), 17u);
}

TEST(Options, AreSavedAndLoadedEach) {
  for (const auto& [name, options] : changed_one_by_one()) {
    const std::string text = text_of(options, name);
    EXPECT_NE(text, text_of({}, name)) << name;
    const World again = load_scene(scene_with(name, text));
    EXPECT_EQ(save_scene(again), save_scene(World(options))) << name;
  }
}

TEST(Options, AreHashedButForThreads) {
  for (const auto& [name, options] : changed_one_by_one())
    EXPECT_EQ(World(options).state_hash() == World().state_hash(), name == "threads") << name;
}

TEST(Options, AreCheckedEach) {
  const WorldOptions defaults;
  EXPECT_NO_THROW(validate(defaults));
  visit_options(defaults, [&](const OptionInfo& wanted, const auto&, auto) {
    WorldOptions options;
    bool can_be_wrong = true;
    visit_options(options, [&](const OptionInfo& info, auto& value, auto) {
      if (std::string(info.name) != wanted.name) return;
      using Value = std::decay_t<decltype(value)>;
      if constexpr (std::is_same_v<Value, Eigen::Vector3d>)
        value.x() = kInfinity;
      else if constexpr (std::is_same_v<Value, bool> || std::is_same_v<Value, Method>)
        can_be_wrong = false;
      else
        value = Value(-1);
    });
    if (!can_be_wrong) return;
    try {
      validate(options);
      ADD_FAILURE() << wanted.name << " is accepted";
    } catch (const std::invalid_argument& error) {
      EXPECT_EQ(std::string(error.what()).rfind(std::string(wanted.name) + ": ", 0), 0u)
          << error.what();
    }
  });
}

// The plan shows options that the methods for islands without contacts read.
TEST(Options, AreInThePlanByMethod) {
  const std::string plan = explain(World());
  const std::string line = plan.substr(0, plan.find('\n'));
  const WorldOptions defaults;
  visit_options(defaults, [&](const OptionInfo& info, const auto&, auto) {
    const bool is_shown =
        info.read_by == Method::kRungeKutta || info.read_by == Method::kEnergyMomentum;
    EXPECT_EQ(line.find(", " + std::string(info.name) + ": ") != std::string::npos, is_shown)
        << info.name;
  });
}

// ---- the manual

/// Strips markup: `[text](address)` becomes text, and code marks are dropped.
std::string plain(const std::string& cell) {
  std::string text;
  for (std::size_t i = 0; i < cell.size(); ++i) {
    const std::size_t middle = cell[i] == '[' ? cell.find("](", i) : std::string::npos;
    const std::size_t end = middle == std::string::npos ? middle : cell.find(')', middle);
    if (end != std::string::npos) {
      text += cell.substr(i + 1, middle - i - 1);
      i = end;
    } else {
      text += cell[i];
    }
  }
  text.erase(std::remove(text.begin(), text.end(), '`'), text.end());
  return text;
}

/// Returns rows of the table of a section of docs/scenes.md, by their first cell.
std::map<std::string, std::vector<std::string>> rows_of(const std::string& section) {
  std::ifstream file(CONSTRAINT_SIM_SCENE_DIR "/../../docs/scenes.md");
  std::map<std::string, std::vector<std::string>> rows;
  bool is_within = false;
  for (std::string line; std::getline(file, line);) {
    if (line.rfind("### ", 0) == 0) is_within = line == "### `" + section + "`";
    if (!is_within || line.rfind("| `", 0) != 0) continue;
    std::vector<std::string> cells;
    std::istringstream stream(line.substr(1));
    for (std::string cell; std::getline(stream, cell, '|');) {
      const std::size_t first = cell.find_first_not_of(' ');
      const std::size_t last = cell.find_last_not_of(' ');
      cells.push_back(first == std::string::npos ? ""
                                                 : plain(cell.substr(first, last - first + 1)));
    }
    rows[cells[0]] = cells;
  }
  return rows;
}

TEST(Options, StandInTheManualAsTheyAre) {
  auto rows = rows_of("world");
  EXPECT_EQ(rows.erase("clock"), 1u);  // belongs to a saved scene, is no option
  const WorldOptions defaults;
  visit_options(defaults, [&](const OptionInfo& info, const auto& value, auto range) {
    const std::vector<std::string> cells = rows[info.name];
    rows.erase(info.name);
    ASSERT_EQ(cells.size(), 4u) << info.name << " has a row of four cells";
    EXPECT_EQ(cells[1], info.unit) << info.name;
    const WorldOptions as_in_manual = load_scene(scene_with(info.name, cells[2])).options();
    EXPECT_EQ(text_of(as_in_manual, info.name), text_of(defaults, info.name)) << info.name;
    EXPECT_EQ(cells[3], range_and_meaning(info, value, range));
  });
  for (const auto& row : rows) ADD_FAILURE() << "no option is called " << row.first;
}

// Parameters of the node that are options of worlds have the same defaults.
TEST(Options, HaveTheDefaultsOfTheNodesParameters) {
  std::ifstream file(CONSTRAINT_SIM_SCENE_DIR "/../parameters.yaml");
  std::map<std::string, std::string> parameters;
  for (std::string line; std::getline(file, line);) {
    const std::size_t colon = line.find(": ");
    if (colon != std::string::npos) parameters[line.substr(0, colon)] = line.substr(colon + 2);
  }
  EXPECT_EQ(parameters.count("closing_time"), 1u);  // the file was read
  const WorldOptions defaults;
  visit_options(defaults, [&](const OptionInfo& info, const auto&, auto) {
    const auto parameter = parameters.find(info.name);
    if (parameter == parameters.end()) return;
    EXPECT_EQ(parameter->second, text_of(defaults, info.name)) << info.name;
  });
}

}  // namespace
}  // namespace constraint_sim::engine
