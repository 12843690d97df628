#include "engine/islands/step_output.h"

#include <algorithm>

namespace constraint_sim::engine {

void StepOutput::set_resting_contacts(const List<TouchingPair>& resting, double time_step) {
  contacts.clear();
  for (const TouchingPair& pair : resting) add_contacts(pair, time_step);
  resting_contact_count = contacts.size();
}

void StepOutput::set_contacts(const List<TouchingPair>& touching, double time_step) {
  contacts.resize(resting_contact_count);
  for (const TouchingPair& pair : touching) add_contacts(pair, time_step);
}

void StepOutput::add_contacts(const TouchingPair& pair, double time_step) {
  for (std::size_t k = 0; k < to_index(pair.manifold.count); ++k) {
    const Manifold::Point& point = pair.manifold.points[k];
    if (point.depth < 0.0 && pair.impulses[k].isZero(0.0)) continue;  // a gap that stayed open
    const Eigen::Vector3d force = pair.impulses[k] / time_step;
    const double normal_force = pair.impulses[k].dot(pair.manifold.normal) / time_step;
    contacts.push_back({pair.id_a, pair.id_b, point.position, pair.manifold.normal, point.depth,
                        normal_force, force, pair.contact_states[k], pair.part_a, pair.part_b});
  }
}

// Sorts events by time; equal times keep their order. Few events are inserted one by one, which
// needs no memory.
void StepOutput::sort_events() {
  constexpr std::size_t kFew = 64;
  const auto is_earlier = [](const Event& l, const Event& r) { return l.time < r.time; };
  if (std::is_sorted(events.begin(), events.end(), is_earlier)) return;
  if (events.size() > kFew) return std::stable_sort(events.begin(), events.end(), is_earlier);
  for (auto next = events.begin(); next != events.end(); ++next)
    std::rotate(std::upper_bound(events.begin(), next, *next, is_earlier), next, next + 1);
}

}  // namespace constraint_sim::engine
