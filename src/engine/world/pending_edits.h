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

/// Answers of a snapshot to questions that its state does not answer.
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
  /// The island that a body is in by the next step begins anew.
  void note_island_of(const Model& model, BodyId body);
  void note_islands_of(const Model& model, const Joint& joint);
  /// The islands of a body or joint begin anew, and their laws are compiled anew.
  void note_laws_of(const Model& model, BodyId body);
  void note_laws_of(const Model& model, const Joint& joint);
  /// The model has other ids than its copies in snapshots.
  void forget_model_mark() { model_mark_.reset(); }

  /// Begins to compile the edits.
  void begin_compiling();
  void end_topology() { topology_ = false; }
  /// Marks the islands of edited bodies, once it is known which islands there are.
  void mark_islands(const Model& model, const Topology& topology, IslandLists* lists);

  /// Whether the model is known to be the same as another.
  bool has_model_of(const PendingEdits& other) const {
    return model_mark_ != nullptr && model_mark_ == other.model_mark_;
  }
  /// Becomes a snapshot of a world, whose answers have to be filled in.
  SnapshotAnswers* begin_snapshot(const PendingEdits& of);
  /// Only of snapshots.
  const std::optional<SnapshotAnswers>& answers() const { return answers_; }
  bool is_edited() const { return answers_ ? answers_->is_edited : any_; }

 private:
  bool any_ = true, topology_ = true, all_ = true;
  std::vector<BodyId> bodies_, relinked_bodies_;
  std::shared_ptr<const char> model_mark_;  // worlds with the same mark have the same model
  std::optional<SnapshotAnswers> answers_;
};

}  // namespace constraint_sim::engine
