#include "ros/reconfigure.h"

#include <dynamic_reconfigure/ConfigDescription.h>
#include <ros/console.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "constraint_sim/engine/options.h"
#include "engine/math/numbers.h"
#include "ros/guarded.h"

namespace constraint_sim {
namespace {

using dynamic_reconfigure::Config;
using dynamic_reconfigure::ConfigDescription;

using engine::kInfinity;
constexpr const char* kGravity[] = {"gravity_x", "gravity_y", "gravity_z"};

// ---- values

void add(const std::string& name, double value, Config* config) {
  config->doubles.emplace_back();
  config->doubles.back().name = name;
  config->doubles.back().value = value;
}
void add(const std::string& name, int value, Config* config) {
  config->ints.emplace_back();
  config->ints.back().name = name;
  config->ints.back().value = value;
}
void add(const std::string& name, bool value, Config* config) {
  config->bools.emplace_back();
  config->bools.back().name = name;
  config->bools.back().value = static_cast<std::uint8_t>(value);
}
void add(const std::string& name, const std::string& value, Config* config) {
  config->strs.emplace_back();
  config->strs.back().name = name;
  config->strs.back().value = value;
}
void add(const std::string& name, engine::Method value, Config* config) {
  add(name, std::string(engine::name(value)), config);
}
void add(const std::string&, const Eigen::Vector3d& value, Config* config) {
  for (int i = 0; i < 3; ++i) add(kGravity[i], value[i], config);
}

void add_group(Config* config) {
  config->groups.emplace_back();
  config->groups.back().name = "Default";
  config->groups.back().state = 1;
}

// ---- descriptions

/// Adds a parameter with its range; set_options checks values exactly.
class Describe {
 public:
  explicit Describe(ConfigDescription* description) : description_(description) {
    description_->groups.emplace_back();
    description_->groups.back().name = "Default";
  }

  void operator()(const engine::OptionInfo& info, const Eigen::Vector3d&, engine::AnyValue) {
    for (const char* name : kGravity) add_number(name, text_of(info), -kInfinity, kInfinity);
  }
  void operator()(const engine::OptionInfo& info, double, engine::Positive range) {
    add_number(info.name, text_of(info), range.least, range.most);
  }
  template <class Range>
  void operator()(const engine::OptionInfo& info, double, Range) {
    const bool is_share = std::is_same_v<Range, engine::Share>;
    add_number(info.name, text_of(info), 0.0, is_share ? 1.0 : kInfinity);
  }
  void operator()(const engine::OptionInfo& info, int, engine::Count range) {
    describe(info.name, "int", text_of(info), "");
    add_range(info.name, 1, range.most);
  }
  void operator()(const engine::OptionInfo& info, int, engine::EitherOf range) {
    describe(info.name, "int", text_of(info),
             choices({std::to_string(range.first), std::to_string(range.second)}, "int"));
    add_range(info.name, std::min(range.first, range.second), std::max(range.first, range.second));
  }
  void operator()(const engine::OptionInfo& info, bool, engine::AnyValue) {
    describe(info.name, "bool", text_of(info), "");
    add_range(info.name, false, true);
  }
  void operator()(const engine::OptionInfo& info, engine::Method, engine::AnyValue) {
    std::vector<std::string> names;
    for (std::size_t i = 0; i < engine::kMethodCount; ++i)
      names.emplace_back(engine::name(static_cast<engine::Method>(i)));
    describe(info.name, "str", text_of(info), choices(names, "str"));
    add_range(info.name, std::string(), std::string());
  }
  void add_number(const std::string& name, const std::string& text, double least, double most) {
    describe(name, "double", text, "");
    add_range(name, least, most);
  }

 private:
  static std::string text_of(const engine::OptionInfo& info) {
    return info.meaning + (*info.unit == '\0' ? "" : " [" + std::string(info.unit) + "]");
  }

  /// Returns a Python literal, which clients evaluate.
  static std::string choices(const std::vector<std::string>& values, const std::string& type) {
    std::string list;
    for (const std::string& value : values)
      list += (list.empty() ? "" : ", ") + ("{'name': '" + value) + "', 'type': '" + type +
              "', 'value': " + (type == "str" ? "'" + value + "'" : value) +
              ", 'description': '', 'srcline': 0, 'srcfile': '', 'cconsttype': '', 'ctype': ''}";
    return "{'enum_description': '', 'enum': [" + list + "]}";
  }

  void describe(const std::string& name, const char* type, const std::string& text,
                const std::string& edit_method) {
    auto& parameters = description_->groups.front().parameters;
    parameters.emplace_back();
    parameters.back().name = name;
    parameters.back().type = type;
    parameters.back().description = text;
    parameters.back().edit_method = edit_method;
  }

  template <class Value>
  void add_range(const std::string& name, const Value& least, const Value& most) {
    add(name, least, &description_->min);
    add(name, most, &description_->max);
  }

  ConfigDescription* description_;
};

ConfigDescription description_with(const Config& defaults) {
  ConfigDescription description;
  Describe describe(&description);
  const engine::WorldOptions options;
  engine::visit_options(options, describe);
  describe.add_number("real_time_factor", "simulated seconds per second; 0: as fast as it can", 0.0,
                      kInfinity);
  describe.add_number("publish_rate", "of topics [Hz]", 0.0, kInfinity);
  for (Config* config : {&description.min, &description.max}) add_group(config);
  description.dflt = defaults;
  return description;
}

// ---- requests

/// Formats a value as in scene files.
std::string word_of(double value) {
  if (std::isnan(value)) return ".nan";
  if (std::isinf(value)) return value < 0.0 ? "-.inf" : ".inf";
  char text[32];
  std::snprintf(text, sizeof text, "%.17g", value);
  return text;
}
std::string word_of(int value) { return std::to_string(value); }
std::string word_of(std::uint8_t value) { return value != 0 ? "true" : "false"; }
std::string word_of(const std::string& value) { return value; }

using Words = std::map<std::string, std::string>;

Words words_of(const Config& config) {
  Words words;
  const auto take = [&](const auto& parameters) {
    for (const auto& parameter : parameters) words[parameter.name] = word_of(parameter.value);
  };
  take(config.doubles);
  take(config.ints);
  take(config.bools);
  take(config.strs);
  return words;
}

}  // namespace

Config config_of(const engine::WorldOptions& options, const Pacing& pacing) {
  Config config;
  engine::visit_options(options, [&](const engine::OptionInfo& info, const auto& value, auto) {
    add(info.name, value, &config);
  });
  add("real_time_factor", pacing.real_time_factor.value_or(1.0), &config);
  add("publish_rate", pacing.publish_rate.value_or(0.0), &config);
  add_group(&config);
  return config;
}

// Gravity is one option of three parameters, so it is in the request as a whole.
SetOptionsRequest request_of(const Config& asked, const Config& present) {
  Words now = words_of(present);
  SetOptionsRequest request;
  bool is_gravity_asked = false;
  const auto is_gravity = [](const std::string& name) {
    return name == kGravity[0] || name == kGravity[1] || name == kGravity[2];
  };
  for (const auto& [name, word] : words_of(asked)) {
    const auto known = now.find(name);
    if (known != now.end() && known->second == word) continue;
    if (is_gravity(name)) {
      known->second = word;
      is_gravity_asked = true;
      continue;
    }
    request.keys.push_back(name);
    request.values.push_back(word);
  }
  if (is_gravity_asked) {
    request.keys.emplace_back("gravity");
    request.values.push_back("[" + now[kGravity[0]] + ", " + now[kGravity[1]] + ", " +
                             now[kGravity[2]] + "]");
  }
  return request;
}

Reconfigure::Reconfigure(const ros::NodeHandle& private_handle, const engine::WorldOptions& options,
                         const Pacing& pacing, SetOptions set_options)
    : set_options_(std::move(set_options)),
      current_(config_of(options, pacing)),
      handle_(private_handle) {
  constexpr bool kLatched = true;
  descriptions_ = handle_.advertise<ConfigDescription>("parameter_descriptions", 1, kLatched);
  descriptions_.publish(description_with(current_));
  updates_ = handle_.advertise<Config>("parameter_updates", 1, kLatched);
  updates_.publish(current_);
  server_ = guarded_service(handle_, "set_parameters", &Reconfigure::set, this);
}

void Reconfigure::edited(const engine::WorldOptions& options, const Pacing& pacing) {
  const Config config = config_of(options, pacing);
  const std::lock_guard<std::mutex> lock(mutex_);
  if (words_of(config) == words_of(current_)) return;
  current_ = config;
  updates_.publish(current_);
}

Config Reconfigure::current() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return current_;
}

bool Reconfigure::set(dynamic_reconfigure::ReconfigureRequest& request,
                      dynamic_reconfigure::ReconfigureResponse& response) {
  SetOptionsRequest asked = request_of(request.config, current());
  if (!asked.keys.empty()) {
    const SetOptionsResponse answer = set_options_(asked);
    if (!answer.success) {
      ROS_WARN("set_parameters: %s", answer.status_message.c_str());
      return false;
    }
  }
  response.config = current();
  return true;
}

}  // namespace constraint_sim
