#include "engine/world/pending_edits.h"

namespace constraint_sim::engine {

void PendingEdits::note_island_of(const Model& model, BodyId body) {
  note();
  if (model.is_movable(model.index(body))) bodies_.push_back(body);
}

void PendingEdits::note_islands_of(const Model& model, const Joint& joint) {
  note_island_of(model, joint.body_a);
  note_island_of(model, joint.body_b);
}

void PendingEdits::note_mass_of(const Model& model, BodyId body) {
  note_island_of(model, body);
  if (model.is_movable(model.index(body))) changed_bodies_.push_back(body);
}

void PendingEdits::note_laws_of(const Model& model, const Joint& joint) {
  note_islands_of(model, joint);
  note_forces_of(model, joint);
}

void PendingEdits::note_forces_of(const Model& model, const Joint& joint) {
  note();
  for (const BodyId body : {joint.body_a, joint.body_b})
    if (model.is_movable(model.index(body))) bodies_with_other_laws_.push_back(body);
}

void PendingEdits::begin_compiling() {
  any_ = false;
  answers_.reset();
  model_mark_ = std::make_shared<const char>();
}

void PendingEdits::mark_islands(const Model& model, const Topology& topology, IslandLists* lists) {
  const auto parts_of = [&](BodyId id) {
    const int body = model.find(id);
    return body < 0 ? nullptr : &lists->island_parts[topology.island_of(to_index(body))];
  };
  for (const BodyId id : bodies_) {
    IslandParts* const parts = parts_of(id);
    if (parts != nullptr) parts->begin_anew();
  }
  bodies_.clear();
  for (const BodyId id : changed_bodies_)
    if (IslandParts* const parts = parts_of(id)) parts->is_stale = true;
  changed_bodies_.clear();
  for (const BodyId id : bodies_with_other_laws_)
    if (IslandParts* const parts = parts_of(id)) parts->has_other_laws = true;
  bodies_with_other_laws_.clear();
  if (all_) lists->restart_all();
  all_ = false;
}

SnapshotAnswers* PendingEdits::begin_snapshot(const PendingEdits& of) {
  model_mark_ = of.model_mark_;
  any_ = topology_ = all_ = true;
  if (!answers_) answers_.emplace();
  answers_->is_edited = of.any_;
  return &*answers_;
}

}  // namespace constraint_sim::engine
