#include "engine/collision/box_features.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "engine/math/list.h"
#include "engine/math/numbers.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;
using Kind = ContactFeature::Kind;

constexpr double kParallelEdgeSine = 1e-5;  // sine below which edges are parallel
// Distance from the middle of an edge, in half edges, beyond which a crossing is ignored.
constexpr double kMostCrossing = 2.0;

/// A box as seen from another one: positions and velocities in the axes of `home`.
struct Seen {
  Seen(const BodyState& home, const BodyState& other)
      : to_home(home.orientation.conjugate()), home(home), other(other) {}

  Vector3d place(const Vector3d& point) const {
    return to_home * (other.position + other.orientation * point - home.position);
  }
  /// Returns the velocity of a point relative to the material of `home` at that point.
  Vector3d velocity(const Vector3d& point) const {
    const Vector3d arm = other.orientation * point;
    const Vector3d from_home = other.position + arm - home.position;
    return to_home * (other.linear_velocity + other.angular_velocity.cross(arm) -
                      home.linear_velocity - home.angular_velocity.cross(from_home));
  }

  Eigen::Quaterniond to_home;
  const BodyState &home, &other;
};

Vector3d corner_of(const Box& box, std::size_t corner) {
  Vector3d at = 0.5 * box.size;
  for (int i = 0; i < 3; ++i)
    if ((corner >> i & 1U) == 0U) at[i] = -at[i];
  return at;
}

/// Corners of a box in the axes of another box, whose faces they may touch.
struct Corners {
  Corners(const Box& box, const Box& home_box, const BodyState& home, const BodyState& other,
          const ContactTolerances& tolerances)
      : half(0.5 * home_box.size), seen(home, other), within(tolerances) {
    for (std::size_t k = 0; k < 8; ++k) {
      own[k] = corner_of(box, k);
      at[k] = seen.place(own[k]);
    }
    for (int face = 0; face < 6; ++face) {
      apart[static_cast<std::size_t>(face)] = kInfinity;
      for (const Vector3d& place : at)
        apart[static_cast<std::size_t>(face)] =
            std::min(apart[static_cast<std::size_t>(face)], beyond(place, face));
    }
  }

  static double side(int face) { return face < 3 ? 1.0 : -1.0; }
  double beyond(const Vector3d& place, int face) const {
    return side(face) * place[face % 3] - half[face % 3];
  }
  int best_face() const {
    return static_cast<int>(std::max_element(apart.begin(), apart.end()) - apart.begin());
  }
  /// Returns a face that the corner is beyond or on; -1: the corner is inside the box.
  int face_of(std::size_t corner) const;

  Vector3d half;
  Seen seen;
  const ContactTolerances& within;
  std::array<Vector3d, 8> own, at;
  std::array<double, 6> apart;  ///< least distance of all corners above each face
};

int Corners::face_of(std::size_t corner) const {
  int farthest = 0, on = -1;
  for (int face = 1; face < 6; ++face)
    if (beyond(at[corner], face) > beyond(at[corner], farthest)) farthest = face;
  if (beyond(at[corner], farthest) > within.border) return farthest;
  const Vector3d velocity = seen.velocity(own[corner]);
  const auto rate = [&](int face) { return side(face) * velocity[face % 3]; };
  // Inside or on the box: a face counts where the whole other box is above it. Of two such faces
  // the corner belongs to the face that it does not move into, as on the seam of a floor in parts;
  // to neither where the other box keeps to the edge between them, beside the box as well as above.
  bool keeps_to_edge = false;
  for (int face = 0; face < 6; ++face) {
    const auto f = static_cast<std::size_t>(face);
    if (beyond(at[corner], face) < -within.overlap || apart[f] < -within.overlap) continue;
    const double farther = on < 0 ? kInfinity : apart[f] - apart[static_cast<std::size_t>(on)];
    const double faster = on < 0 ? 0.0 : rate(face) - rate(on);
    const bool is_tie = std::abs(farther) <= within.border;
    const bool decides = is_tie && std::abs(faster) > within.resting;
    keeps_to_edge = (is_tie && !decides && rate(face) >= -within.resting) ||
                    (keeps_to_edge && !decides && farther <= 0.0);
    if (decides ? faster > 0.0 : farther > 0.0) on = face;
  }
  if (keeps_to_edge) return -1;
  // A corner at the border of this face that moves outward belongs to the adjacent face.
  for (int face = 0; face < 6; ++face)
    if (face % 3 != on % 3 && beyond(at[corner], face) >= -within.border &&
        rate(face) > within.resting)
      return face;
  return on;
}

void set_face(const Box& box, int face, Vector3d* point, Vector3d* axis) {
  *axis = Vector3d::Zero();
  (*axis)[face % 3] = Corners::side(face);
  *point = 0.5 * box.size.cwiseProduct(*axis);
}

// Adds the corners of a box, each on a face of the other box.
void add_corners(const Corners& corners, const Box& home, bool is_of_a, int only_face,
                 List<ContactFeature>* features) {
  for (std::size_t k = 0; k < 8; ++k) {
    ContactFeature feature;
    const int face = only_face >= 0 ? only_face : corners.face_of(k);
    feature.kind = face < 0 ? Kind::kNothing : is_of_a ? Kind::kPlane : Kind::kPlaneOfA;
    Vector3d point = Vector3d::Zero(), axis = Vector3d::UnitZ();
    if (face >= 0) set_face(home, face, &point, &axis);
    feature.on_a = is_of_a ? corners.own[k] : point;
    feature.on_b = is_of_a ? point : corners.own[k];
    (is_of_a ? feature.axis : feature.axis_a) = axis;
    feature.id =
        static_cast<std::uint32_t>((is_of_a ? 0 : 64) + 8 * static_cast<int>(k) + face + 1);
    features->push_back(feature);
  }
}

void add_nothing(std::size_t count, List<ContactFeature>* features) {
  ContactFeature nothing;
  nothing.kind = Kind::kNothing;
  features->insert(features->end(), count, nothing);
}

/// Edge of a box with the normals of its two faces.
struct Edge {
  Edge(const Box& box, const BodyState& state, int number) : axis(number % 3) {
    for (int k = 0; k < 2; ++k) {
      const int across = (axis + 1 + k) % 3;
      middle[across] =
          (number / 3 >> k & 1) != 0 ? 0.5 * box.size[across] : -0.5 * box.size[across];
      outward[static_cast<std::size_t>(k)] =
          state.orientation * (Vector3d::Unit(across) * (middle[across] < 0.0 ? -1.0 : 1.0));
    }
    half = 0.5 * box.size[axis];
  }

  int axis;
  double half;
  Vector3d middle = Vector3d::Zero();  ///< middle of the edge in the box's frame [m]
  std::array<Vector3d, 2> outward;     ///< outward normals of its faces, world
};

/// Nearest points of the lines of two edges, as distances from the middles of the edges, with their
/// rates.
struct Crossing {
  Crossing(const ContactFeature& feature, const BodyState& a, const BodyState& b)
      : u(a.orientation * feature.axis_a),
        v(b.orientation * feature.axis),
        to_a(a.orientation * feature.on_a),
        to_b(b.orientation * feature.on_b),
        apart(b.position + to_b - a.position - to_a),
        c(u.cross(v)),
        square(c.squaredNorm()) {
    on_a = apart.cross(v).dot(c) / square;
    on_b = apart.cross(u).dot(c) / square;
  }
  void move(const BodyState& a, const BodyState& b) {
    const Vector3d apart_dot = b.linear_velocity + b.angular_velocity.cross(to_b) -
                               a.linear_velocity - a.angular_velocity.cross(to_a);
    u_dot = a.angular_velocity.cross(u);
    const Vector3d v_dot = b.angular_velocity.cross(v);
    c_dot = u_dot.cross(v) + u.cross(v_dot);
    const double square_dot = 2.0 * c.dot(c_dot);
    on_a_dot = ((apart_dot.cross(v) + apart.cross(v_dot)).dot(c) + apart.cross(v).dot(c_dot) -
                on_a * square_dot) /
               square;
    on_b_dot = ((apart_dot.cross(u) + apart.cross(u_dot)).dot(c) + apart.cross(u).dot(c_dot) -
                on_b * square_dot) /
               square;
  }

  Vector3d u, v, to_a, to_b, apart, c;
  double square, on_a, on_b;
  Vector3d u_dot, c_dot;
  double on_a_dot = 0.0, on_b_dot = 0.0;
};

// Whether both edges support their boxes along n, so that neither box extends farther than its
// edge.
bool support(const Edge& of_a, const Edge& of_b, const Vector3d& n) {
  constexpr double kLevel = 1e-6;  // tolerance, a sine
  return std::all_of(of_a.outward.begin(), of_a.outward.end(),
                     [&](const Vector3d& out) { return n.dot(out) <= kLevel; }) &&
         std::all_of(of_b.outward.begin(), of_b.outward.end(),
                     [&](const Vector3d& out) { return n.dot(out) >= -kLevel; });
}

bool is_outside(double at, double rate, double half, const ContactTolerances& within) {
  const double beyond = std::abs(at) - half;
  if (beyond > within.border) return true;
  const double outwards = at < 0.0 ? -rate : rate;
  return beyond >= -within.border &&
         outwards > -within.resting;  // a corner touches at the end of an edge
}

/// Nearest pairs of edges in ascending distance; ties keep their order of adding.
struct NearestEdges {
  static constexpr std::ptrdiff_t kMostEdgePairs{kBoxEdges};

  void add(double distance, const ContactFeature& feature) {
    auto* const end = distances.begin() + count;
    const auto place = std::upper_bound(distances.begin(), end, distance) - distances.begin();
    if (place == kMostEdgePairs) return;
    count = std::min(count + 1, kMostEdgePairs);
    std::move_backward(distances.begin() + place, distances.begin() + count - 1,
                       distances.begin() + count);
    std::move_backward(features.begin() + place, features.begin() + count - 1,
                       features.begin() + count);
    distances[static_cast<std::size_t>(place)] = distance;
    features[static_cast<std::size_t>(place)] = feature;
  }

  std::array<double, kBoxEdges> distances;
  std::array<ContactFeature, kBoxEdges> features;
  std::ptrdiff_t count = 0;
};

// Adds pairs of edges that face each other, the nearest first.
void add_edges(const Box& box_a, const BodyState& a, const Box& box_b, const BodyState& b,
               const ContactTolerances& within, List<ContactFeature>* features) {
  NearestEdges found;
  for (int i = 0; i < 12; ++i) {
    const Edge of_a(box_a, a, i);
    for (int j = 0; j < 12; ++j) {
      const Edge of_b(box_b, b, j);
      ContactFeature feature;
      feature.kind = Kind::kEdges;
      feature.on_a = of_a.middle;
      feature.axis_a = Vector3d::Unit(of_a.axis);
      feature.on_b = of_b.middle;
      feature.axis = Vector3d::Unit(of_b.axis);
      Crossing crossing(feature, a, b);
      if (!(crossing.square > kParallelEdgeSine * kParallelEdgeSine)) continue;
      if (std::abs(crossing.on_a) > kMostCrossing * of_a.half ||
          std::abs(crossing.on_b) > kMostCrossing * of_b.half)
        continue;
      Vector3d n = crossing.c / std::sqrt(crossing.square);
      const double of_n_a = n.dot(of_a.outward[0] + of_a.outward[1]);
      const double of_n_b = n.dot(of_b.outward[0] + of_b.outward[1]);
      if (!(of_n_a * of_n_b < 0.0)) continue;  // edges that do not face each other
      feature.sign = of_n_a < 0.0 ? 1.0 : -1.0;
      n *= feature.sign;
      const double gap = -n.dot(crossing.apart);
      if (gap < -within.overlap) continue;
      crossing.move(a, b);
      if (gap <= within.border &&
          (!support(of_a, of_b, n) ||
           is_outside(crossing.on_a, crossing.on_a_dot, of_a.half, within) ||
           is_outside(crossing.on_b, crossing.on_b_dot, of_b.half, within)))
        continue;
      feature.id = static_cast<std::uint32_t>(128 + 12 * i + j);
      const double beyond =
          std::max({0.0, std::abs(crossing.on_a) - of_a.half, std::abs(crossing.on_b) - of_b.half});
      found.add(std::max(gap, 0.0) + beyond, feature);
    }
  }
  features->insert(features->end(), found.features.begin(), found.features.begin() + found.count);
  add_nothing(kBoxEdges - static_cast<std::size_t>(found.count), features);
}

FeatureMargin nearer(const FeatureMargin& l, const FeatureMargin& r) {
  return r.value < l.value ? r : l;
}

FeatureMargin to_end(double at, double rate, double half) {
  return {half - std::abs(at), at < 0.0 ? rate : -rate};
}

}  // namespace

void add_box_features(const Box& box_a, const BodyState& a, const Box& box_b, const BodyState& b,
                      const ContactTolerances& within, List<ContactFeature>* features) {
  const Corners of_a(box_a, box_b, b, a, within), of_b(box_b, box_a, a, b, within);
  const int on_b = of_a.best_face(), on_a = of_b.best_face();
  const double above_b = of_a.apart[static_cast<std::size_t>(on_b)];
  const double above_a = of_b.apart[static_cast<std::size_t>(on_a)];
  if (std::max(above_a, above_b) <= within.border) {
    add_corners(of_a, box_b, true, -1, features);
    add_corners(of_b, box_a, false, -1, features);
    add_edges(box_a, a, box_b, b, within, features);
  } else if (above_b >= above_a) {
    add_corners(of_a, box_b, true, on_b, features);
    add_nothing(kBoxCorners + kBoxEdges - 8, features);
  } else {
    add_nothing(8, features);
    add_corners(of_b, box_a, false, on_a, features);
    add_nothing(kBoxEdges, features);
  }
}

FeatureMargin margin_of_boxes(const ContactFeature& feature, const Box& box_a, const BodyState& a,
                              const Box& box_b, const BodyState& b) {
  FeatureMargin least{kInfinity, 0.0};
  if (feature.kind == Kind::kEdges) {
    Crossing crossing(feature, a, b);
    crossing.move(a, b);
    const double half_a = 0.5 * box_a.size.dot(feature.axis_a);
    const double half_b = 0.5 * box_b.size.dot(feature.axis);
    return nearer(to_end(crossing.on_a, crossing.on_a_dot, half_a),
                  to_end(crossing.on_b, crossing.on_b_dot, half_b));
  }
  const bool is_of_a = feature.kind == Kind::kPlane;
  const Seen seen(is_of_a ? b : a, is_of_a ? a : b);
  const Vector3d& corner = is_of_a ? feature.on_a : feature.on_b;
  const Vector3d& axis = is_of_a ? feature.axis : feature.axis_a;
  const Vector3d half = 0.5 * (is_of_a ? box_b : box_a).size;
  const Vector3d place = seen.place(corner), velocity = seen.velocity(corner);
  for (int i = 0; i < 3; ++i)
    if (axis[i] == 0.0) least = nearer(least, to_end(place[i], velocity[i], half[i]));
  return least;
}

ContactMotion motion_of_edges(const ContactFeature& feature, const BodyState& a,
                              const BodyState& b) {
  Crossing crossing(feature, a, b);
  crossing.move(a, b);
  const double length = std::sqrt(crossing.square);
  ContactMotion motion;
  motion.n = feature.sign * crossing.c / length;
  motion.n_dot = feature.sign * crossing.c_dot / length;
  motion.n_dot -= motion.n * motion.n.dot(motion.n_dot);
  motion.gap = -motion.n.dot(crossing.apart);
  motion.r_a = crossing.to_a + crossing.on_a * crossing.u;
  motion.p = a.position + motion.r_a;
  motion.r_b = motion.p - b.position;
  const Vector3d p_dot =
      a.linear_velocity + a.angular_velocity.cross(motion.r_a) + crossing.on_a_dot * crossing.u;
  set_velocities(p_dot, a, b, &motion);
  return motion;
}

}  // namespace constraint_sim::engine
