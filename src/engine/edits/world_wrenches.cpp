#include <algorithm>
#include <cmath>

#include "engine/model/validate.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {

void World::add_wrench(const Wrench& wrench) {
  const std::size_t i = impl_->index(wrench.body);
  const std::string name = in_quotes(impl_->bodies[i].name);
  if (!impl_->is_movable(i)) refuse("body", name + " is not dynamic");
  check_finite("force", wrench.force);
  check_finite("torque", wrench.torque);
  if (impl_->masses[i].inertia.isZero(0.0) && !wrench.torque.isZero(0.0))
    refuse("torque",
           name + " is a point mass without inertia and cannot turn, got " + shown(wrench.torque));
  check_finite("start", wrench.start);
  if (std::isfinite(wrench.end)) check_finite("end", wrench.end);
  if (!(wrench.end > wrench.start))
    refuse("end", "must be after the start at " + shortest(wrench.start) + ", got " +
                      shortest(wrench.end));

  if (wrench.end <= time()) return;
  impl_->sleep.wake(i, impl_.get());
  impl_->wrenches.push_back(wrench);
}

void World::clear_wrenches(BodyId id) {
  impl_->index(id);
  std::vector<Wrench>& all = impl_->wrenches;
  const auto is_on_it = [id](const Wrench& wrench) { return wrench.body == id; };
  all.erase(std::remove_if(all.begin(), all.end(), is_on_it), all.end());
  impl_->monitors.note_wrench_ended();
}

}  // namespace constraint_sim::engine
