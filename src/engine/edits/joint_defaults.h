#pragma once

#include "constraint_sim/engine/joint.h"
#include "engine/model/model.h"
#include "engine/model/state.h"

namespace constraint_sim::engine {

// Fills in settings that a joint leaves out, from the poses of its bodies. Each function throws
// std::invalid_argument where the result is invalid.

/// Sets fields that joints of this kind have no use for to their defaults. Nothing checks them, and
/// a snapshot must not hold numbers that are not finite.
void clear_unused(Joint* joint);

/// Clears unused fields, and fills in the length, frames, offsets of coordinates and constants of
/// springs. A rigid distance joint of length 0 becomes a ball joint.
void fill_in(const Model& model, const State& state, Joint* joint);

/// Fills in zeros of coordinates, from the positions that the coordinates are to read.
void set_zeros(const Model& model, const State& state, Joint* joint);

/// Fills in constants of springs and servos, from their frequencies.
void fill_in_laws(const Model& model, const State& state, Joint* joint);

}  // namespace constraint_sim::engine
