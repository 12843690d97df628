#include "problem.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>

namespace constraint_sim::report {
namespace {

using Maker = std::vector<Problem> (*)();

std::vector<Maker>& makers() {
  static std::vector<Maker> list;
  return list;
}

using SizedMaker = Problem (*)(int);

std::map<std::string, SizedMaker>& kinds() {
  static std::map<std::string, SizedMaker> map;
  return map;
}

/// Returns a problem named KIND_COUNT; nullptr for other names.
const Problem* sized_problem(const std::string& name) {
  static std::map<std::string, Problem> made;
  const std::size_t end = name.rfind('_');
  const auto kind = kinds().find(name.substr(0, end));
  if (end == std::string::npos || kind == kinds().end()) return nullptr;
  const auto found = made.find(name);
  if (found != made.end()) return &found->second;
  Problem problem = kind->second(std::stoi(name.substr(end + 1)));
  problem.name = name;
  return &made.emplace(name, std::move(problem)).first->second;
}

}  // namespace

const char* name(JointKind kind) {
  switch (kind) {
    case JointKind::kRod:
    case JointKind::kBall:
    case JointKind::kSpring:
    case JointKind::kFreeLength:
      break;
    case JointKind::kHinge:
      return "hinge";
    case JointKind::kSlider:
      return "slider";
    case JointKind::kCylindrical:
      return "cylindrical";
    case JointKind::kPlanar:
      return "planar";
    case JointKind::kUniversal:
      return "universal";
    case JointKind::kWeld:
      return "weld";
    case JointKind::kPointOnLine:
      return "point_on_line";
    case JointKind::kPointOnPlane:
      return "point_on_plane";
  }
  return nullptr;
}

Registration::Registration(Maker make) { makers().push_back(make); }
Registration::Registration(const std::string& kind, SizedMaker make) { kinds()[kind] = make; }

const std::vector<Problem>& problems() {
  static const std::vector<Problem> kAll = [] {
    std::vector<Problem> list;
    for (const Maker make : makers())
      for (Problem& problem : make()) list.push_back(std::move(problem));
    std::sort(list.begin(), list.end(),
              [](const Problem& a, const Problem& b) { return a.name < b.name; });
    return list;
  }();
  return kAll;
}

const Problem& problem_named(const std::string& name) {
  if (const Problem* sized = sized_problem(name)) return *sized;
  for (const Problem& problem : problems())
    if (problem.name == name) return problem;
  throw std::invalid_argument("there is no problem '" + name + "'");
}

const Coupling* Problem::screw_of(std::size_t joint) const {
  for (const Coupling& coupling : couplings)
    if (coupling.is_screw() && coupling.first == static_cast<int>(joint)) return &coupling;
  return nullptr;
}

int Problem::samples() const { return static_cast<int>(std::lround(duration / sample)); }

bool Problem::has_shapes() const {
  return std::any_of(bodies.begin(), bodies.end(),
                     [](const Body& body) { return body.shape != Shape::kPoint; });
}

}  // namespace constraint_sim::report
