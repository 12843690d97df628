#pragma once

#include <cstddef>
#include <optional>

#include "engine/collision/broadphase.h"
#include "engine/math/list.h"
#include "engine/model/model.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

class ContactGroups;
class ContactReach;
class ContinuousCollision;
class Rollback;
class Topology;
struct IslandLists;
struct StepContext;

/// Everything that AssumedPaths reads once the bodies of a step have moved.
struct MovedBodies {
  const StepContext& step;
  const State& state;  ///< state after the motion; kinematic bodies have not moved yet
  const Rollback& rollback;
  const IslandLists& lists;
  const List<int>& moving_shapes;
  const ContactReach& reach;
  const ContactGroups& groups;
  const ContinuousCollision& continuous;
};

/// Paths of bodies that springs, motors, wrenches and joints accelerate within a step. Velocities
/// at the start of a step and gravity tell which pairs may meet. After the motion the path of each
/// such body is compared with the path that they allow. Where it was longer and leads to a shape
/// not looked at, the step is repeated from its start with the longer path, at most kMostRepeats
/// times. Most steps compare and repeat nothing.
class AssumedPaths {
 public:
  /// Largest number of repeats of a step.
  static constexpr int kMostRepeats = 4;

  /// Takes over which shapes move, and lists the shapes on joints.
  void set_shapes(const Model& model, const Topology& topology, const IslandLists& lists,
                  const List<int>& moving_shapes);
  void begin_step() {
    if (repeats_ == 0) return;
    paths_.clear();
    repeats_ = 0;
  }

  /// Whether this attempt of the step assumes paths beside velocities and gravity.
  bool has_longer_paths() const { return !paths_.empty(); }
  /// Path of a body that this attempt assumes [m]; 0 where velocity and gravity bound it.
  double of(int body) const { return paths_.empty() ? 0.0 : paths_[body]; }

  /// Whether joints or wrenches may move a shape further than assumed. False in scenes in which
  /// nothing can touch.
  bool may_outrun(const State& state) const {
    return has_shapes_ && !(on_joints_.empty() && state.wrenches.empty());
  }
  /// Returns a body whose path was longer than assumed and may have met a shape that was not looked
  /// at. `broadphase` knows the shapes that rest.
  std::optional<int> find_missed(const MovedBodies& in, Broadphase* broadphase);
  /// Takes over the longer paths for a repeat of the step. False after kMostRepeats repeats.
  bool lengthen(std::size_t bodies);

 private:
  struct Outrun {
    int body;
    double path;  // [m]
  };

  void list_outrun(const MovedBodies& in);
  const List<Broadphase::Pair>& find_near(const MovedBodies& in, Broadphase* broadphase);
  bool is_missed(const MovedBodies& in, const Broadphase::Pair& pair) const;

  bool has_shapes_ = false;  // whether shapes move that may touch something
  List<int> on_joints_;      // dynamic bodies with moving shapes, on islands with joints; ascending
  int repeats_ = 0;          // repeats of this step
  List<double> paths_;       // assumed path of each body [m]; empty in the first attempt of a step
  List<Outrun> outrun_;      // bodies whose paths were longer than assumed
  List<double> found_;  // path of each body in this attempt [m], once bodies have outrun theirs
  List<Proxy> proxies_;
};

}  // namespace constraint_sim::engine
