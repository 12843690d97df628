#include "ros/marker_lines.h"

#include <algorithm>
#include <cmath>

namespace constraint_sim {
namespace {

using Eigen::Vector3d;

constexpr double kPi = 3.14159265358979323846;
constexpr int kCoilTurns = 8;
constexpr int kPartsOfTurn = 10;
constexpr double kStraightEnd = 0.1;  // share of a spring's length
constexpr int kArcParts = 18;
constexpr double kArc = 1.5 * kPi;  // [rad]

}  // namespace

Eigen::Quaterniond turn_of_z(const Vector3d& direction) {
  const double w = 1.0 + direction.z();
  if (w < 1e-9) return {0.0, 1.0, 0.0, 0.0};  // half a turn about x, to rounding of messages
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

void add_arrow(const Vector3d& from, const Vector3d& along, double length, double head,
               Lines* lines) {
  if (!(length > 0.0)) return;
  const double size = std::min(head, length);
  const Vector3d to = from + length * along;
  const Vector3d back = to - size * along;
  const Vector3d u = 0.5 * size * along.unitOrthogonal();
  const Vector3d v = along.cross(u);
  const std::size_t first = lines->size();
  lines->resize(first + 10);
  geometry_msgs::Point* point = lines->data() + first;
  const geometry_msgs::Point tip = point_at(to);
  *point++ = point_at(from);
  *point++ = tip;
  for (const Vector3d& side : {u, v}) {
    *point++ = tip;
    *point++ = point_at(back - side);
    *point++ = tip;
    *point++ = point_at(back + side);
  }
}

void add_turning_arrow(double radius, bool positive, Lines* lines) {
  const double sign = positive ? 1.0 : -1.0;
  const auto at = [&](double angle) -> Vector3d {
    return radius * Vector3d(std::cos(angle), sign * std::sin(angle), 0.0);
  };
  for (int i = 0; i < kArcParts; ++i)
    add_line(at(kArc * i / kArcParts), at(kArc * (i + 1) / kArcParts), lines);
  const Vector3d out = at(kArc) / radius;
  const Vector3d before = at(kArc - 0.5);
  add_line(at(kArc), before + 0.25 * radius * out, lines);
  add_line(at(kArc), before - 0.25 * radius * out, lines);
}

// A parabola whose length is the rope's to some percent.
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

void add_strut(double length, double radius, Lines* lines) {
  const double head = 0.5 * length, mouth = 0.35 * length;
  const auto at = [](const Vector3d& side, double z) -> Vector3d {
    return side + z * Vector3d::UnitZ();
  };
  add_line(Vector3d::Zero(), {0.0, 0.0, head}, lines);
  for (const Vector3d axis : {Vector3d::UnitX(), Vector3d::UnitY()}) {
    const Vector3d side = radius * axis;
    add_line(at(-side, head), at(side, head), lines);
    add_line(at(-side, length), at(side, length), lines);
    add_line(at(-side, mouth), at(-side, length), lines);
    add_line(at(side, mouth), at(side, length), lines);
  }
}

void stretch(double factor, Lines* lines) {
  for (geometry_msgs::Point& point : *lines) point.z *= factor;
}

}  // namespace constraint_sim
