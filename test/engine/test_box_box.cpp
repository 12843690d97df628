// Contacts of boxes against an independent oracle in long double: depths along all axes by
// projecting vertices, and the overlap polygon of two faces by testing each of its possible
// corners.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "draw.h"
#include "engine/collision/narrowphase.h"

namespace constraint_sim::engine {
namespace {

using Eigen::AngleAxisd;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Real = long double;
constexpr Real kRealInfinity = std::numeric_limits<Real>::infinity();
using Vector3 = Eigen::Matrix<Real, 3, 1>;
using Vector2 = Eigen::Matrix<Real, 2, 1>;
using Matrix3 = Eigen::Matrix<Real, 3, 3>;

/// Random sizes and poses of boxes.
class BoxDraw : public Draw {
 public:
  BoxDraw() : Draw(23) {}
  double power(double low, double high) { return std::pow(10.0, between(low, high)); }
  Quaterniond turn(double angle) {
    return Quaterniond(AngleAxisd(angle, vector_between(-1.0, 1.0).normalized()));
  }
  Quaterniond orientation() { return turn(between(-M_PI, M_PI)); }
};

struct ScaledBoxes {
  Vector3d size_a = Vector3d::Ones(), size_b = Vector3d::Ones();
  BodyState a, b;

  Manifold contact() const { return collide(Box{size_a}, a, Box{size_b}, b); }
  /// Sum of the largest edges [m].
  double scale() const { return size_a.maxCoeff() + size_b.maxCoeff(); }
  /// Motion of vertices by rounding [m]: half a unit in the last place per coordinate, and some ten
  /// operations; quaternions are normalized to a few units.
  double rounding() const {
    return 4e-15 * (scale() + a.position.cwiseAbs().sum() + b.position.cwiseAbs().sum());
  }
};

/// A box in long double; the centre of B is the origin, so that distant boxes lose no digits.
struct OracleBox {
  OracleBox(const Vector3d& size, const BodyState& state, const Vector3d& origin)
      : half(size.cast<Real>() / 2), centre(state.position.cast<Real>() - origin.cast<Real>()) {
    axes = state.orientation.cast<Real>().normalized().toRotationMatrix();
  }

  std::vector<Vector3> vertices() const {
    std::vector<Vector3> all;
    for (int i = 0; i < 8; ++i) {
      const Vector3 sign((i & 1) != 0 ? 1 : -1, (i & 2) != 0 ? 1 : -1, (i & 4) != 0 ? 1 : -1);
      all.push_back(centre + axes * sign.cwiseProduct(half));
    }
    return all;
  }

  /// Returns the corners of the face across axis k, in order, widened by `wider` on each side.
  std::array<Vector3, 4> face(int k, bool upper, Real wider = 0) const {
    const Vector3 middle = centre + (upper ? half[k] : -half[k]) * axes.col(k);
    const Vector3 u = (half[(k + 1) % 3] + wider) * axes.col((k + 1) % 3);
    const Vector3 v = (half[(k + 2) % 3] + wider) * axes.col((k + 2) % 3);
    return {middle - u - v, middle + u - v, middle + u + v, middle - u + v};
  }

  Vector3 half, centre;
  Matrix3 axes;
};

/// Returns the distance that A has to move along n to be past B.
Real depth_along(const Vector3& n, const OracleBox& a, const OracleBox& b) {
  Real lowest_a = kRealInfinity;
  Real highest_b = -kRealInfinity;
  for (const Vector3& p : a.vertices()) lowest_a = std::min(lowest_a, n.dot(p));
  for (const Vector3& p : b.vertices()) highest_b = std::max(highest_b, n.dot(p));
  return highest_b - lowest_a;
}

struct OracleAxis {
  Vector3 n;
  Real depth;
};

/// Returns all possible directions of least depth.
std::vector<OracleAxis> all_axes(const OracleBox& a, const OracleBox& b) {
  std::vector<Vector3> directions;
  for (int i = 0; i < 3; ++i) {
    directions.push_back(a.axes.col(i));
    directions.push_back(b.axes.col(i));
    for (int j = 0; j < 3; ++j) {
      const Vector3 cross = a.axes.col(i).cross(b.axes.col(j));
      if (cross.norm() > 1e-14L) directions.push_back(cross.normalized());
    }
  }
  std::vector<OracleAxis> axes;
  for (const Vector3& n : directions) {
    axes.push_back({n, depth_along(n, a, b)});
    axes.push_back({-n, depth_along(-n, a, b)});
  }
  return axes;
}

bool is_within(const Vector2& p, const std::array<Vector2, 4>& polygon, Real slack) {
  Real orientation = 0;
  for (int i = 0; i < 4; ++i) {
    const Vector2& p_0 = polygon[i];
    const Vector2& p_1 = polygon[(i + 1) % 4];
    orientation += p_0.x() * p_1.y() - p_0.y() * p_1.x();
  }
  for (int i = 0; i < 4; ++i) {
    const Vector2 side = polygon[(i + 1) % 4] - polygon[i];
    const Vector2 to_p = p - polygon[i];
    const Real cross = side.x() * to_p.y() - side.y() * to_p.x();
    if ((orientation > 0 ? cross : -cross) < -slack * side.norm()) return false;
  }
  return true;
}

struct Corner {
  Vector3 p;
  Real off;  ///< motion of the corner where a side moves by the slack [m]
};

/// Returns the corners of the overlap of two faces, on the face above: corners of one face within
/// the other, and crossings of sides. With sides off by `slack`: the possible corners, or the sure
/// ones where `is_sure`.
std::vector<Corner> corners_of_overlap(const std::array<Vector3, 4>& under,
                                       const std::array<Vector3, 4>& over, Real slack,
                                       bool is_sure) {
  const Vector3 e_1 = (under[1] - under[0]).normalized();
  const Vector3 e_2 = (under[3] - under[0]).normalized();
  const Vector3 n = (over[1] - over[0]).cross(over[3] - over[0]);
  const auto flat = [&](const Vector3& p) {
    return Vector2(e_1.dot(p - under[0]), e_2.dot(p - under[0]));
  };
  std::array<Vector2, 4> flat_under, flat_over;
  for (int i = 0; i < 4; ++i) {
    flat_under[i] = flat(under[i]);
    flat_over[i] = flat(over[i]);
  }
  std::vector<Corner> corners;
  const Real border = is_sure ? -slack : slack;
  const Vector3 up = e_1.cross(e_2);
  const auto lifted = [&](const Vector3& p) -> Vector3 {
    return p + up * (n.dot(over[0] - p) / n.dot(up));
  };
  for (int i = 0; i < 4; ++i) {
    const Real steep = 1 / std::abs(n.normalized().dot(up));
    if (is_within(flat_over[i], flat_under, border)) corners.push_back({over[i], slack});
    if (is_within(flat_under[i], flat_over, border))
      corners.push_back({lifted(under[i]), slack * steep});
    for (int j = 0; j < 4; ++j) {
      const Vector2 p = flat_under[i];
      const Vector2 along = flat_under[(i + 1) % 4] - p;
      const Vector2 q = flat_over[j];
      const Vector2 side = flat_over[(j + 1) % 4] - q;
      const Real det = along.x() * side.y() - along.y() * side.x();
      if (std::abs(det) < 1e-12L * along.norm() * side.norm()) continue;
      const Real s = ((q - p).x() * side.y() - (q - p).y() * side.x()) / det;
      const Real t = ((q - p).x() * along.y() - (q - p).y() * along.x()) / det;
      const Real off = slack * along.norm() * side.norm() / std::abs(det);
      const Real s_slack = (is_sure ? -off : off) / along.norm();
      const Real t_slack = (is_sure ? -off : off) / side.norm();
      if (s < -s_slack || s > 1 + s_slack || t < -t_slack || t > 1 + t_slack) continue;
      const Vector3 along_over = over[(j + 1) % 4] - over[j];
      corners.push_back({over[j] + t * along_over, off * along_over.norm() / side.norm()});
    }
  }
  return corners;
}

/// Oracle for the contact of two boxes.
struct Oracle {
  explicit Oracle(const ScaledBoxes& pair)
      : boxes(pair),
        a(pair.size_a, pair.a, pair.b.position),
        b(pair.size_b, pair.b, pair.b.position),
        axes(all_axes(a, b)) {
    for (const OracleAxis& axis : axes) least = std::min(least, axis.depth);
  }

  void check(const Manifold& contact) const {
    const Real rounding = boxes.rounding();
    if (least <= -rounding) {
      EXPECT_EQ(contact.count, 0);
      return;
    }
    if (contact.count == 0) {
      // only where rounding decides, or at the border of a widened face
      EXPECT_LE(least, rounding);
      return;
    }
    const Vector3 n = contact.normal.cast<Real>();
    // Rounding: some ten operations on numbers of size 1; cross products amplify it by 1/sine up to
    // 1e4, beyond which the engine does not use them.
    EXPECT_NEAR(static_cast<double>(n.norm()), 1.0, 1e-14);
    expect_allowed(n);
    for (int k = 0; k < 3; ++k) {
      if (is_along(a, k, n)) return expect_overlap(contact, a, b, k, false);
      if (is_along(b, k, n)) return expect_overlap(contact, b, a, k, true);
    }
    expect_crossing(contact, n);
  }

  static bool is_along(const OracleBox& box, int k, const Vector3& n) {
    return std::abs(n.dot(box.axes.col(k))) > 1 - 1e-14L;  // as exact as the length of n
  }

  /// Expects the normal of least depth, or of a face within the cosine that the engine allows.
  void expect_allowed(const Vector3& n) const {
    Real best = -1;
    for (const OracleAxis& axis : axes)
      if (axis.depth <= least + 100 * boxes.rounding()) best = std::max(best, n.dot(axis.n));
    EXPECT_GE(static_cast<double>(best), 0.999 - 1e-9);
  }

  /// Expects the corners of the overlap as points: all below the face, each once. The engine widens
  /// the face by 1e-6 of the smallest half edge.
  void expect_overlap(const Manifold& contact, const OracleBox& under, const OracleBox& over, int k,
                      bool is_of_b) const {
    const Vector3 to_over = over.centre - under.centre;
    const bool upper = under.axes.col(k).dot(to_over) > 0;
    const Vector3 outward = (upper ? 1 : -1) * under.axes.col(k);
    const Real wider = 1e-6L * std::min(under.half.minCoeff(), over.half.minCoeff());
    const auto face = under.face(k, upper, wider);
    std::vector<Vector3> found;
    found.reserve(8);
    for (int i = 0; i < contact.count; ++i) found.push_back(point_on(contact, i, is_of_b));
    Real best = 0;
    for (int j = 0; j < 3; ++j) best = std::max(best, std::abs(outward.dot(over.axes.col(j))));
    for (int j = 0; j < 3; ++j) {
      const Real cosine = outward.dot(over.axes.col(j));
      if (std::abs(cosine) < best - 1e-9L) continue;  // either face is right in a tie
      if (is_overlap(contact, found, face, over.face(j, cosine < 0), outward)) return;
    }
    ADD_FAILURE() << "no overlap of faces has these points";
  }

  bool is_overlap(const Manifold& contact, const std::vector<Vector3>& found,
                  const std::array<Vector3, 4>& face, const std::array<Vector3, 4>& opposite,
                  const Vector3& outward) const {
    const Real slack = 10 * boxes.rounding();
    const Real level = outward.dot(face[0]);
    const auto is_at = [](const Corner& corner, const Vector3& p) {
      return (corner.p - p).norm() <= 10 * corner.off;
    };
    const auto may_be = corners_of_overlap(face, opposite, slack, false);
    for (std::size_t i = 0; i < found.size(); ++i) {
      if (std::none_of(may_be.begin(), may_be.end(),
                       [&](const Corner& corner) { return is_at(corner, found[i]); }))
        return false;
      if (std::abs(level - outward.dot(found[i]) - contact.points[i].depth) > slack) return false;
    }
    for (const Corner& corner : corners_of_overlap(face, opposite, slack, true)) {
      if (level - outward.dot(corner.p) <= 10 * corner.off) continue;  // corner above the face
      if (std::none_of(found.begin(), found.end(),
                       [&](const Vector3& p) { return is_at(corner, p); }))
        return false;
    }
    return true;
  }

  /// Returns the point of a contact on the box above the face.
  Vector3 point_on(const Manifold& contact, int i, bool is_of_b) const {
    const Manifold::Point& point = contact.points[i];
    const Vector3 on_b = (point.position - boxes.b.position).cast<Real>();
    return is_of_b ? Vector3(on_b - static_cast<Real>(point.depth) * contact.normal.cast<Real>())
                   : on_b;
  }

  /// Expects one point, on an edge of each box, with the depth of the direction.
  void expect_crossing(const Manifold& contact, const Vector3& n) const {
    ASSERT_EQ(contact.count, 1);
    const Real depth = contact.points[0].depth;
    const Real slack = 1000 * static_cast<Real>(boxes.rounding());
    EXPECT_NEAR(static_cast<double>(depth - depth_along(n, a, b)), 0.0, static_cast<double>(slack));
    const Vector3 on_b = (contact.points[0].position - boxes.b.position).cast<Real>();
    const Vector3 on_a = on_b - depth * n;
    EXPECT_GE(sides_met(a, on_a, slack), 2);
    EXPECT_GE(sides_met(b, on_b, slack), 2);
  }

  static int sides_met(const OracleBox& box, const Vector3& p, Real slack) {
    const Vector3 local = box.axes.transpose() * (p - box.centre);
    int met = 0;
    for (int k = 0; k < 3; ++k) {
      const Real beyond = std::abs(local[k]) - box.half[k];
      EXPECT_LE(static_cast<double>(beyond), static_cast<double>(slack));
      if (std::abs(beyond) <= slack) ++met;
    }
    return met;
  }

  const ScaledBoxes& boxes;
  OracleBox a, b;
  std::vector<OracleAxis> axes;
  Real least = kRealInfinity;  ///< depth [m]
};

constexpr int kBoxBoxTrials = 3000;

/// Checks boxes arranged by `make`; at least this share of them has to touch.
template <class Make>
void check_box_pairs(double least_share, Make make) {
  BoxDraw random;
  int touching = 0;
  for (int trial = 0; trial < kBoxBoxTrials; ++trial) {
    const ScaledBoxes boxes = make(random);
    const Manifold contact = boxes.contact();
    const Oracle oracle(boxes);
    oracle.check(contact);
    touching += contact.count > 0 ? 1 : 0;
    if (testing::Test::HasFailure())
      FAIL() << "trial " << trial << ", depth " << static_cast<double>(oracle.least) << ", points "
             << contact.count << ", normal " << contact.normal.transpose();
  }
  EXPECT_GE(touching, least_share * kBoxBoxTrials);
}

TEST(BoxBoxOracle, Random) {
  check_box_pairs(0.4, [](BoxDraw& random) {
    ScaledBoxes boxes;
    boxes.size_a = random.vector_between(0.1, 2.0);
    boxes.size_b = random.vector_between(0.1, 2.0);
    boxes.a.position = random.vector_between(-1.0, 1.0);
    boxes.a.orientation = random.orientation();
    boxes.b.orientation = random.orientation();
    return boxes;
  });
}

// Boxes with all edges parallel, or nearly.
TEST(BoxBoxOracle, Parallel) {
  check_box_pairs(0.4, [](BoxDraw& random) {
    ScaledBoxes boxes;
    boxes.size_a = random.vector_between(0.1, 2.0);
    boxes.size_b = random.vector_between(0.1, 2.0);
    boxes.a.position = random.vector_between(-1.0, 1.0);
    boxes.b.orientation = random.orientation();
    const double tilt = random.between(0.0, 1.0) < 0.2 ? 0.0 : random.power(-16.0, -2.0);
    boxes.a.orientation = boxes.b.orientation * random.turn(tilt);
    return boxes;
  });
}

// A box on the face of another, rotated about the vertical, overhanging, with slight tilt and
// depth.
TEST(BoxBoxOracle, VertexAndFaceOnFace) {
  check_box_pairs(0.6, [](BoxDraw& random) {
    ScaledBoxes boxes;
    boxes.size_a = random.vector_between(0.5, 1.5);
    boxes.size_b = random.vector_between(0.5, 1.5);
    const AngleAxisd yaw(random.between(-M_PI, M_PI), Vector3d::UnitZ());
    boxes.a.orientation = random.turn(random.power(-12.0, -0.3)) * yaw;
    const Vector3d reach = boxes.a.orientation.toRotationMatrix().cwiseAbs() * boxes.size_a;
    boxes.a.position = random.vector_between(-0.7, 0.7);
    boxes.a.position.z() = 0.5 * (boxes.size_b.z() + reach.z()) - random.power(-9.0, -1.0);
    return boxes;
  });
}

// Crossing beams on their edges, also at small angles.
TEST(BoxBoxOracle, EdgeOnEdge) {
  check_box_pairs(0.9, [](BoxDraw& random) {
    ScaledBoxes boxes;
    boxes.size_a = boxes.size_b = {10.0, 1.0, 1.0};
    const AngleAxisd roll(M_PI / 4.0, Vector3d::UnitX());
    const AngleAxisd yaw(random.power(-3.0, 0.0), Vector3d::UnitZ());
    boxes.a.orientation = roll;
    boxes.b.orientation = yaw * roll;
    const double between_edges = 2.0 * std::sqrt(0.5);
    boxes.a.position = {random.between(-1.0, 1.0), 0.0, between_edges - random.power(-9.0, -2.0)};
    return boxes;
  });
}

TEST(BoxBoxOracle, OneWithinTheOther) {
  check_box_pairs(1.0, [](BoxDraw& random) {
    ScaledBoxes boxes;
    boxes.size_a = random.vector_between(0.01, 0.3);
    boxes.size_b = random.vector_between(1.0, 3.0);
    boxes.a.position = random.vector_between(-0.2, 0.2);
    boxes.a.orientation = random.orientation();
    boxes.b.orientation = random.orientation();
    if (random.between(0.0, 1.0) < 0.5) {
      std::swap(boxes.size_a, boxes.size_b);
      boxes.a.position = -boxes.a.position;
    }
    return boxes;
  });
}

TEST(BoxBoxOracle, GrainOnAMountain) {
  check_box_pairs(0.3, [](BoxDraw& random) {
    ScaledBoxes boxes;
    boxes.size_a = random.power(-4.0, -2.0) * random.vector_between(0.5, 1.0);
    boxes.size_b = 100.0 * random.vector_between(0.5, 1.0);
    boxes.a.orientation = random.orientation();
    const double reach = boxes.size_a.norm();
    boxes.a.position = 0.4 * random.vector_between(-1.0, 1.0).cwiseProduct(boxes.size_b);
    boxes.a.position.z() = 0.5 * boxes.size_b.z() + random.between(-0.5, 0.5) * reach;
    return boxes;
  });
}

TEST(BoxBoxOracle, FarFromTheOrigin) {
  check_box_pairs(0.4, [](BoxDraw& random) {
    ScaledBoxes boxes;
    boxes.size_a = random.vector_between(0.1, 2.0);
    boxes.size_b = random.vector_between(0.1, 2.0);
    boxes.b.position = 1e6 * random.vector_between(-1.0, 1.0);
    boxes.a.position = boxes.b.position + random.vector_between(-1.0, 1.0);
    boxes.a.orientation = random.orientation();
    boxes.b.orientation = random.orientation();
    return boxes;
  });
}

}  // namespace
}  // namespace constraint_sim::engine
