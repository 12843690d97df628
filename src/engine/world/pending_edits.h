#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "constraint_sim/engine/id.h"
#include "constraint_sim/engine/island.h"
#include "engine/islands/island_lists.h"
#include "engine/islands/topology.h"
#include "engine/model/model.h"

namespace constraint_sim::engine {

/// Answers to queries that a snapshot stores, since it has no islands to answer from.
struct SnapshotAnswers {
  bool is_edited = false;  ///< the world was edited since its last step
  std::vector<Island> islands;
  std::vector<BodyId> unresolved_bodies;
};

/// Edits that the next step has to compile. A snapshot is a world that counts as edited.
class PendingEdits {
 public:
  bool any() const { return any_; }
  /// Whether bodies, joints, or which joints act have changed.
  bool any_topology() const { return topology_; }
  /// Whether all islands begin anew.
  bool all() const { return all_; }
  /// Bodies whose islands begin anew.
  const std::vector<BodyId>& bodies() const { return bodies_; }
  /// Bodies on joints whose laws have changed.
  const std::vector<BodyId>& bodies_with_other_laws() const { return bodies_with_other_laws_; }

  void note() {
    any_ = true;
    model_mark_.reset();
    answers_.reset();
  }
  void note_topology() {
    note();
    topology_ = true;
  }
  void note_all() {
    note();
    all_ = true;
  }
  /// Marks the island of a body, as of the next step: its method begins anew. Ignores bodies that
  /// are not dynamic.
  void note_island_of(const Model& model, BodyId body);
  void note_islands_of(const Model& model, const Joint& joint);
  /// Marks the island of a body: its method begins anew, and its equations are compiled anew.
  void note_mass_of(const Model& model, BodyId body);
  /// Marks the islands of a joint: methods begin anew, with other laws.
  void note_laws_of(const Model& model, const Joint& joint);
  /// Marks the islands of a joint, which go on with other forces where IslandLists::goes_on().
  void note_forces_of(const Model& model, const Joint& joint);
  /// Separates the model from its copies in snapshots, whose ids differ now.
  void forget_model_mark() { model_mark_.reset(); }

  /// Begins to compile the edits.
  void begin_compiling();
  void end_topology() { topology_ = false; }
  /// Marks the islands of edited bodies, once it is known which islands there are.
  void mark_islands(const Model& model, const Topology& topology, IslandLists* lists);

  /// Whether the model is known to equal the model of `other`.
  bool has_model_of(const PendingEdits& other) const {
    return model_mark_ != nullptr && model_mark_ == other.model_mark_;
  }
  /// Turns these edits into those of a snapshot of `of`'s world. The caller fills in the answers.
  SnapshotAnswers* begin_snapshot(const PendingEdits& of);
  /// Stored answers of a snapshot; empty for other worlds.
  const std::optional<SnapshotAnswers>& answers() const { return answers_; }
  bool is_edited() const { return answers_ ? answers_->is_edited : any_; }

 private:
  bool any_ = true, topology_ = true, all_ = true;
  std::vector<BodyId> bodies_;
  std::vector<BodyId> changed_bodies_;  // mass or inertia
  std::vector<BodyId> bodies_with_other_laws_;
  std::shared_ptr<const char> model_mark_;  // worlds with the same mark have the same model
  std::optional<SnapshotAnswers> answers_;
};

}  // namespace constraint_sim::engine
