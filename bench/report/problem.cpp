#include "problem.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace constraint_sim::report {
namespace {

using Maker = std::vector<Problem> (*)();

std::vector<Maker>& makers() {
  static std::vector<Maker> list;
  return list;
}

}  // namespace

Registration::Registration(Maker make) { makers().push_back(make); }

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
  for (const Problem& problem : problems())
    if (problem.name == name) return problem;
  throw std::invalid_argument("there is no problem '" + name + "'");
}

int Problem::samples() const { return static_cast<int>(std::lround(duration / sample)); }

bool Problem::has_shapes() const {
  return std::any_of(bodies.begin(), bodies.end(),
                     [](const Body& body) { return body.shape != Shape::kPoint; });
}

}  // namespace constraint_sim::report
