#include "engine/methods/event_driven/joints/event_variants.h"

#include <algorithm>
#include <utility>

namespace constraint_sim::engine {
namespace {

constexpr std::size_t kMostVariants = 16;

}  // namespace

EventVariants::EventVariants(const EventJoints& joints, const List<MassProperties>& masses)
    : bare_(joints.compile(List<OneSidedState>(joints.laws().size()), List<char>(joints.size(), 0),
                           masses)),
      compiled_for_(joints.laws().size()),
      broken_then_(joints.size(), 0) {}

void EventVariants::compile_bare(const EventJoints& joints, const List<char>& is_broken,
                                 const List<MassProperties>& masses) {
  bare_ = joints.compile(List<OneSidedState>(joints.laws().size()), is_broken, masses);
}

void EventVariants::compile_again(const EventJoints& joints, const List<char>& is_broken,
                                  const List<MassProperties>& masses, RungeKutta* motion) {
  compile_bare(joints, is_broken, masses);
  *motion = RungeKutta(joints.compile(compiled_for_, broken_then_, masses));
}

bool EventVariants::follow_laws(const EventJoints& joints, const List<char>& is_broken,
                                RungeKutta* motion) {
  const auto is_outdated = [&](Variant& other) {
    return !joints.update(other.states, other.is_broken, other.motion.equations().joints(),
                          &other.motion);
  };
  others_.erase(std::remove_if(others_.begin(), others_.end(), is_outdated), others_.end());
  const List<OneSidedState> none(joints.laws().size());
  return joints.update(none, is_broken, bare_.joints(), &bare_) &&
         joints.update(compiled_for_, broken_then_, motion->equations().joints(), motion);
}

bool EventVariants::switch_to(const EventJoints& joints, const List<OneSidedState>& states,
                              const List<char>& is_broken, const List<MassProperties>& masses,
                              RungeKutta* motion) {
  if (compiled_for_ == states && broken_then_ == is_broken) return false;
  const auto found = std::find_if(others_.begin(), others_.end(), [&](const Variant& other) {
    return other.states == states && other.is_broken == is_broken;
  });
  const double step = motion->step();
  if (found != others_.end()) {
    std::swap(*motion, found->motion);
    std::swap(compiled_for_, found->states);
    std::swap(broken_then_, found->is_broken);
  } else {
    if (others_.size() >= kMostVariants) others_.erase(others_.begin());
    others_.push_back({compiled_for_, broken_then_, std::move(*motion)});
    *motion = RungeKutta(joints.compile(states, is_broken, masses));
    compiled_for_ = states;
    broken_then_ = is_broken;
  }
  motion->restart();
  motion->set_step(step);
  return true;
}

}  // namespace constraint_sim::engine
