#include "ros/marker_lines.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "engine/math/numbers.h"

namespace constraint_sim {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

using engine::kPi;
constexpr int kCoilTurns = 8;
constexpr int kPartsOfTurn = 10;
constexpr double kStraightEnd = 0.1;  // share of a spring's length
constexpr int kArcParts = 18;
constexpr double kArc = 1.5 * kPi;  // [rad]
constexpr double kHeadOfArc = 0.5;  // [rad]
constexpr int kThreadTurns = 10;
constexpr int kPartsOfThread = 8;       // per turn
constexpr double kRootOfThread = 0.65;  // radius between the crests, over theirs
constexpr int kCircleParts = 16;
constexpr int kMostTeethOfRack = 60;

const std::array<Vector2d, kCircleParts>& unit_circle() {
  static const std::array<Vector2d, kCircleParts> points = [] {
    std::array<Vector2d, kCircleParts> made;
    for (int i = 0; i < kCircleParts; ++i) {
      const double angle = 2.0 * kPi * i / kCircleParts;
      made[static_cast<std::size_t>(i)] = {std::cos(angle), std::sin(angle)};
    }
    return made;
  }();
  return points;
}

}  // namespace

Eigen::Quaterniond turn_of_z(const Vector3d& direction) {
  const double w = 1.0 + direction.z();
  if (w < 1e-9)
    return {0.0, 1.0, 0.0, 0.0};  // half a turn about x; exact to the rounding of messages
  const double scale = 1.0 / std::sqrt(2.0 * w);
  return {scale * w, -scale * direction.y(), scale * direction.x(), 0.0};
}

void add_line(const Vector3d& from, const Vector3d& to, Lines* lines) {
  lines->push_back(point_at(from));
  lines->push_back(point_at(to));
}

void add_dashes(const Vector3d& from, const Vector3d& to, Lines* lines) {
  const Vector3d part = (to - from) / (2 * kDashes - 1);
  for (int i = 0; i < kDashes; ++i) add_line(from + 2 * i * part, from + (2 * i + 1) * part, lines);
}

void write_arrow(const Vector3d& from, const Vector3d& along, double length, double head,
                 geometry_msgs::Point* to) {
  const double size = std::min(head, length);
  const Vector3d end = from + length * along;
  const Vector3d back = end - size * along;
  const Vector3d u = 0.5 * size * along.unitOrthogonal();
  const Vector3d v = along.cross(u);
  const geometry_msgs::Point tip = point_at(end);
  *to++ = point_at(from);
  *to++ = tip;
  for (const Vector3d* side : {&u, &v}) {
    *to++ = tip;
    *to++ = point_at(back - *side);
    *to++ = tip;
    *to++ = point_at(back + *side);
  }
}

void add_arrow(const Vector3d& from, const Vector3d& along, double length, double head,
               Lines* lines) {
  if (!(length > 0.0)) return;
  lines->resize(lines->size() + kArrowPoints);
  write_arrow(from, along, length, head, lines->data() + lines->size() - kArrowPoints);
}

void add_turning_arrow(double radius, double z, bool positive, Lines* lines) {
  const double sign = positive ? 1.0 : -1.0;
  const auto at = [&](double angle, double of_radius) -> Vector3d {
    return {of_radius * radius * std::cos(angle), sign * of_radius * radius * std::sin(angle), z};
  };
  const double begin = kArc - kHeadOfArc;  // start of the head, a flat arrow head
  for (int i = 0; i < kArcParts; ++i)
    add_line(at(kArc * i / kArcParts, 1.0), at(kArc * (i + 1) / kArcParts, 1.0), lines);
  const Vector3d tip = at(kArc, 1.0), up(0.0, 0.0, 0.2 * radius);
  for (const Vector3d& end : {at(begin, 1.2), at(begin, 0.8), Vector3d(at(begin, 1.0) + up),
                              Vector3d(at(begin, 1.0) - up)})
    add_line(tip, end, lines);
}

void add_circle(const Vector3d& middle, const Vector3d& u, const Vector3d& v, Lines* lines) {
  const std::array<Vector2d, kCircleParts>& unit = unit_circle();
  const auto at = [&](int i) -> Vector3d {
    const Vector2d& of = unit[static_cast<std::size_t>(i % kCircleParts)];
    return middle + of.x() * u + of.y() * v;
  };
  for (int i = 0; i < kCircleParts; ++i) add_line(at(i), at(i + 1), lines);
}

void add_toothed_wheel(double radius, double depth, int teeth, double z, Lines* lines) {
  const auto at = [&](double tooth, double r) -> Vector3d {
    const double angle = 2.0 * kPi * tooth / teeth;
    return {r * std::cos(angle), r * std::sin(angle), z};
  };
  const double top = radius + 0.5 * depth, root = radius - 0.5 * depth;
  for (int i = 0; i < teeth; ++i) {
    add_line(at(i, root), at(i + 0.25, top), lines);
    add_line(at(i + 0.25, top), at(i + 0.5, top), lines);
    add_line(at(i + 0.5, top), at(i + 0.75, root), lines);
    add_line(at(i + 0.75, root), at(i + 1.0, root), lines);
  }
}

void add_teeth(const Vector3d& from, const Vector3d& to, const Vector3d& depth, double width,
               Lines* lines) {
  const double length = (to - from).norm();
  const int teeth = std::clamp(static_cast<int>(length / width), 1, kMostTeethOfRack);
  const Vector3d part = (to - from) / teeth;
  for (int i = 0; i < teeth; ++i) {
    const Vector3d begin = from + i * part;
    add_line(begin, begin + 0.25 * part + depth, lines);
    add_line(begin + 0.25 * part + depth, begin + 0.5 * part + depth, lines);
    add_line(begin + 0.5 * part + depth, begin + 0.75 * part, lines);
    add_line(begin + 0.75 * part, begin + part, lines);
  }
}

void add_cross(double half, Lines* lines) {
  for (const Vector3d& corner :
       {Vector3d(1, 1, 1), Vector3d(1, 1, -1), Vector3d(1, -1, 1), Vector3d(-1, 1, 1)})
    add_line(-half * corner, half * corner, lines);
}

void add_sheet(double half, bool has_arrows, Lines* lines) {
  const Vector3d x = half * Vector3d::UnitX(), y = half * Vector3d::UnitY();
  add_line(x + y, x - y, lines);
  add_line(x - y, -x - y, lines);
  add_line(-x - y, y - x, lines);
  add_line(y - x, x + y, lines);
  for (const Vector3d& way : {x, y, Vector3d(-x), Vector3d(-y)}) {
    if (has_arrows)
      add_arrow(Vector3d::Zero(), way / half, 0.9 * half, 0.2 * half, lines);
    else
      add_line(Vector3d::Zero(), way, lines);
  }
}

// Sets a parabola whose length equals the rope's within some percent.
void set_rope(const Vector3d& to, double length, const Vector3d& down, Lines* lines) {
  const double sag = std::sqrt(3.0 / 16.0 * std::max(length * length - to.squaredNorm(), 0.0));
  lines->resize(2 * kRopeParts);
  geometry_msgs::Point* point = lines->data();
  *point++ = geometry_msgs::Point();
  for (int i = 1; i < kRopeParts; ++i) {
    const double t = static_cast<double>(i) / kRopeParts;
    point[0] = point[1] = point_at(t * to + 4.0 * sag * t * (1.0 - t) * down);
    point += 2;
  }
  *point = point_at(to);
}

void add_straight(double length, Lines* lines) {
  const double part = length / kRopeParts;
  for (int i = 0; i < kRopeParts; ++i)
    add_line({0.0, 0.0, i * part}, {0.0, 0.0, (i + 1) * part}, lines);
}

void add_coil(double length, double radius, Lines* lines) {
  constexpr int kParts = kCoilTurns * kPartsOfTurn;
  const auto at = [&](int i) -> Vector3d {
    const double t = static_cast<double>(i) / kParts;
    const double angle = 2.0 * kPi * i / kPartsOfTurn;
    return {radius * std::cos(angle), radius * std::sin(angle),
            (kStraightEnd + (1.0 - 2.0 * kStraightEnd) * t) * length};
  };
  const Vector3d begin(0.0, 0.0, kStraightEnd * length);
  const Vector3d end(0.0, 0.0, (1.0 - kStraightEnd) * length);
  add_line(Vector3d::Zero(), begin, lines);
  add_line(begin, at(0), lines);
  for (int i = 0; i < kParts; ++i) add_line(at(i), at(i + 1), lines);
  add_line(at(kParts), end, lines);
  add_line(end, {0.0, 0.0, length}, lines);
}

void add_strut(Lines* triangles) {
  const std::array<Vector2d, kCircleParts>& unit = unit_circle();
  // Surfaces of revolution about z, one after the other, from (radius, z) to (radius, z).
  struct Profile {
    double radius, z, to_radius, to_z;
  };
  for (const Profile& part : {Profile{0.0, 0.0, 1.2, 0.0},     // disc at the piston's end
                              Profile{0.45, 0.0, 0.45, 0.5},   // piston
                              Profile{0.45, 0.42, 1.0, 0.42},  // mouth of the sleeve
                              Profile{1.0, 0.42, 1.0, 1.0},    // sleeve
                              Profile{0.0, 1.0, 1.2, 1.0}}) {
    for (int i = 0; i < kCircleParts; i += 2) {
      const Vector2d& one = unit[static_cast<std::size_t>(i)];
      const Vector2d& other = unit[static_cast<std::size_t>((i + 2) % kCircleParts)];
      const auto at = [](const Vector2d& of, double radius, double z) {
        return point_at({radius * of.x(), radius * of.y(), z});
      };
      for (const geometry_msgs::Point& corner :
           {at(one, part.radius, part.z), at(one, part.to_radius, part.to_z),
            at(other, part.to_radius, part.to_z)})
        triangles->push_back(corner);
      if (part.radius == 0.0) continue;
      for (const geometry_msgs::Point& corner :
           {at(one, part.radius, part.z), at(other, part.to_radius, part.to_z),
            at(other, part.radius, part.z)})
        triangles->push_back(corner);
    }
  }
}

// Adds facets from the root up to the crest, and down to the root of the next turn.
void add_thread(bool is_right, Lines* triangles) {
  constexpr int kParts = kThreadTurns * kPartsOfThread;
  const double sign = is_right ? 1.0 : -1.0;
  const auto at = [&](int i, double radius, int along) {
    const double angle = 2.0 * kPi * i / kPartsOfThread;
    const double z = std::clamp(static_cast<double>(along) / kParts, 0.0, 1.0);
    return point_at({radius * std::cos(angle), sign * radius * std::sin(angle), z});
  };
  const auto root = [&](int i, int turns) {
    return at(i, kRootOfThread, i + turns * kPartsOfThread - kPartsOfThread / 2);
  };
  const auto crest = [&](int i) { return at(i, 1.0, i); };
  const auto add_facet = [&](const geometry_msgs::Point& a, const geometry_msgs::Point& b,
                             const geometry_msgs::Point& c, const geometry_msgs::Point& d) {
    // Corners go round one way as seen from outside: rviz derives the lit side from it.
    for (const geometry_msgs::Point& corner : {a, is_right ? b : c, is_right ? c : b})
      triangles->push_back(corner);
    for (const geometry_msgs::Point& corner : {a, is_right ? c : d, is_right ? d : c})
      triangles->push_back(corner);
  };
  for (int i = 0; i <= kParts; ++i) {
    add_facet(root(i, 0), root(i + 1, 0), crest(i + 1), crest(i));
    add_facet(crest(i), crest(i + 1), root(i + 1, 1), root(i, 1));
  }
}

void stretch(double factor, Lines* lines) {
  for (geometry_msgs::Point& point : *lines) point.z *= factor;
}

}  // namespace constraint_sim
