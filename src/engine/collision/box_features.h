#pragma once

#include <cstddef>

#include "engine/collision/contact_feature.h"
#include "engine/collision/contact_tolerances.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

// Features by which two boxes can touch: a corner of one and a face of the other, or an edge of
// each. A pair has a constant number of features: 8 corners of A, 8 corners of B, and the nearest
// pairs of edges; unused ones are kNothing.
// - Boxes separated by a face: corners of the other box against this face. While all are above it,
//   edges do not touch.
// - Other boxes: each corner against a face that it is beyond or on, and edges that face each
//   other. On touching faces these features are the vertices of the area of contact.

inline constexpr std::size_t kBoxCorners = 16, kBoxEdges = 16;  ///< number of features of a pair
/// Adds kBoxCorners features of corners, then kBoxEdges of pairs of edges, the nearest first.
void add_box_features(const Box& box_a, const BodyState& a, const Box& box_b, const BodyState& b,
                      const ContactTolerances& within, List<ContactFeature>* features);

/// Returns distance and rate of a corner from the border of its face, or of the crossing of two
/// edges from the end of an edge.
FeatureMargin margin_of_boxes(const ContactFeature& feature, const Box& box_a, const BodyState& a,
                              const Box& box_b, const BodyState& b);

}  // namespace constraint_sim::engine
