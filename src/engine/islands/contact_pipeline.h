#pragma once

#include "engine/collision/broadphase.h"
#include "engine/islands/contact_reach.h"
#include "engine/islands/sleep.h"
#include "engine/islands/step.h"
#include "engine/math/list.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

/// Stages 1 and 2 of a step: which shapes may touch, and where they touch.
class ContactPipeline {
 public:
  /// Takes over which bodies move, and which rest.
  void set_shapes(const Model& model, const State& state, const List<int>& awake_bodies,
                  const List<int>& resting_bodies);
  /// Bodies that move and whose shapes may touch something; empty where no shape can.
  const List<int>& moving_shapes() const { return moving_shapes_; }

  /// Finds pairs whose bounds overlap within the step. `fast_bodies`, in the order of
  /// moving_shapes(), sweep their bounds; `reach` widens all bounds, or is null.
  void find_pairs(const StepContext& step, const State& state, const List<int>& fast_bodies,
                  const ContactReach* reach, StepReport* report);
  const List<Broadphase::Pair>& pairs() const { return broadphase_.pairs(); }
  /// The broadphase with the shapes that rest.
  Broadphase* broadphase() { return &broadphase_; }

  void begin_step() { is_collided_ = false; }
  /// Replaces the contacts of the step before by contacts where the shapes are now, with the
  /// impulses of the step before.
  void collide(const StepContext& step, State* state, StepReport* report);
  /// Contacts of the step before; where the shapes were not collided yet, of the step before that.
  const List<TouchingPair>& touching_before() const { return touching_before_; }
  /// Restores the contacts of the step before, and forgets the contacts of this step.
  void restore_contacts(List<TouchingPair>* touching);

  /// Visits everything that the next step continues from, as engine/support/memory.h describes.
  template <class Self, class Visit>
  static void visit_memory(Self& self, Visit& visit) {
    visit(self.touching_before_);
  }

 private:
  Broadphase broadphase_;
  List<int> moving_shapes_;
  List<Proxy> proxies_;
  List<TouchingPair> touching_before_;
  bool is_collided_ = false;  // in this step
};

}  // namespace constraint_sim::engine
