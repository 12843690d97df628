#pragma once

#include <cstddef>

#include "engine/collision/contact_feature.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

// What of two boxes can meet: a corner of one and a face of the other, and an edge of each. A pair
// has the same number of features wherever the boxes are: 8 corners of A, 8 corners of B, and
// those edges that are nearest to each other, some of which are nothing.
//
// - Apart by a face: the corners of the other box against that face. As long as none of these is
//   below it the boxes are apart, whatever their edges do.
// - Else, near: each corner against a face that it is beyond of, so that it is known to be outside,
//   or that it lies on; and edges that face each other.
//
// Where faces lie on each other the corners of one in the other and the places where edges cross
// are the corners of the area in which they touch. One that gets to the border of a face, or to the
// end of an edge, is one of others from there on.

inline constexpr std::size_t kBoxCorners = 16, kBoxEdges = 16;  ///< features of a pair
/// [m] boxes that overlap by less are taken as touching.
inline constexpr double kBoxOverlap = 1e-7;

/// Adds kBoxCorners + kBoxEdges features; of edges the nearest ones first.
void add_box_features(const Box& box_a, const BodyState& a, const Box& box_b, const BodyState& b,
                      List<ContactFeature>* features);

/// How far, and how fast, a corner is from the border of the face that it is on, or where two edges
/// cross from their ends.
FeatureMargin margin_of_boxes(const ContactFeature& feature, const Box& box_a, const BodyState& a,
                              const Box& box_b, const BodyState& b);

}  // namespace constraint_sim::engine
