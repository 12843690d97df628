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
  for (Variant& other : others_) other.has_old_laws = true;
  const List<OneSidedState> none(joints.laws().size());
  return joints.update(none, is_broken, bare_.joints(), &bare_) &&
         joints.update(compiled_for_, broken_then_, motion->equations().joints(), motion);
}

// Lets an earlier compilation take over the laws of the joints. Returns false where it cannot.
bool EventVariants::is_up_to_date(const EventJoints& joints, Variant* variant) const {
  return !std::exchange(variant->has_old_laws, false) ||
         joints.update(variant->states, variant->is_broken, variant->motion.equations().joints(),
                       &variant->motion);
}

bool EventVariants::switch_to(const EventJoints& joints, const List<OneSidedState>& states,
                              const List<char>& is_broken, const List<MassProperties>& masses,
                              RungeKutta* motion) {
  const auto compile = [&] { return joints.compile(states, is_broken, masses); };
  return switch_to(joints, states, is_broken, compile, motion);
}

void EventVariants::begin_anew(const EventJoints& joints, const List<char>& is_broken,
                               RungeKutta* motion) {
  const List<OneSidedState> none(joints.laws().size());
  switch_to(
      joints, none, is_broken, [&] { return bare_; }, motion);
}

template <class Compile>
bool EventVariants::switch_to(const EventJoints& joints, const List<OneSidedState>& states,
                              const List<char>& is_broken, const Compile& compile,
                              RungeKutta* motion) {
  if (compiled_for_ == states && broken_then_ == is_broken) return false;
  auto found = std::find_if(others_.begin(), others_.end(), [&](const Variant& other) {
    return other.states == states && other.is_broken == is_broken;
  });
  if (found != others_.end() && !is_up_to_date(joints, &*found)) {
    others_.erase(found);
    found = others_.end();
  }
  const double step = motion->step();
  if (found != others_.end()) {
    std::swap(*motion, found->motion);
    std::swap(compiled_for_, found->states);
    std::swap(broken_then_, found->is_broken);
  } else {
    if (others_.size() >= kMostVariants) others_.erase(others_.begin());
    others_.push_back({compiled_for_, broken_then_, std::move(*motion), false});
    *motion = RungeKutta(compile());
    compiled_for_ = states;
    broken_then_ = is_broken;
  }
  motion->restart();
  *motion->next_step() = step;
  return true;
}

}  // namespace constraint_sim::engine
