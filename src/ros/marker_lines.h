#pragma once

#include <geometry_msgs/Point.h>
#include <geometry_msgs/Quaternion.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <vector>

namespace constraint_sim {

/// Points of a LINE_LIST: two points a line.
using Lines = std::vector<geometry_msgs::Point>;

/// Converts a finite point.
inline geometry_msgs::Point point_at(const Eigen::Vector3d& v) {
  geometry_msgs::Point point;
  point.x = v.x();
  point.y = v.y();
  point.z = v.z();
  return point;
}
inline geometry_msgs::Quaternion quaternion_of(const Eigen::Quaterniond& q) {
  geometry_msgs::Quaternion quaternion;
  quaternion.x = q.x();
  quaternion.y = q.y();
  quaternion.z = q.z();
  quaternion.w = q.w();
  return quaternion;
}

/// Returns a rotation that turns z to `direction` (unit).
Eigen::Quaterniond turn_of_z(const Eigen::Vector3d& direction);

/// Adds kDashes dashes, with gaps as long as the dashes.
inline constexpr int kDashes = 8;
void add_dashes(const Eigen::Vector3d& from, const Eigen::Vector3d& to, Lines* lines);
void add_line(const Eigen::Vector3d& from, const Eigen::Vector3d& to, Lines* lines);
/// Adds an arrow of this length [m] along a direction (unit), with a head of length `head` at most,
/// visible from all sides.
void add_arrow(const Eigen::Vector3d& from, const Eigen::Vector3d& along, double length,
               double head, Lines* lines);
inline constexpr std::size_t kArrowPoints = 10;
/// Writes the kArrowPoints points of an arrow as add_arrow() draws it; `length` > 0.
void write_arrow(const Eigen::Vector3d& from, const Eigen::Vector3d& along, double length,
                 double head, geometry_msgs::Point* to);
/// Adds three quarters of a circle about z, at height z, with an arrow head; clockwise as seen
/// against z where not `positive`.
void add_turning_arrow(double radius, double z, bool positive, Lines* lines);
/// Adds a circle about a point, from u towards v, whose lengths are the radius.
void add_circle(const Eigen::Vector3d& middle, const Eigen::Vector3d& u, const Eigen::Vector3d& v,
                Lines* lines);
/// Adds a wheel about z at height z. Its teeth reach half of `depth` outside the radius.
void add_toothed_wheel(double radius, double depth, int teeth, double z, Lines* lines);
/// Adds a row of teeth, each `width` wide and `depth` high.
void add_teeth(const Eigen::Vector3d& from, const Eigen::Vector3d& to, const Eigen::Vector3d& depth,
               double width, Lines* lines);
/// Adds the diagonals of a cube with this half edge.
void add_cross(double half, Lines* lines);
/// Adds a square in the x-y plane with a cross in it, with arrows at its ends where `has_arrows`.
void add_sheet(double half, bool has_arrows, Lines* lines);
/// Replaces lines by a rope of this length from the origin to a point: kRopeParts lines that sag
/// along `down` (unit) where the rope is longer than the distance.
inline constexpr int kRopeParts = 16;
void set_rope(const Eigen::Vector3d& to, double length, const Eigen::Vector3d& down, Lines* lines);

// Lines along z from the origin, which stretch() makes longer.
/// Adds a straight rope of kRopeParts lines.
void add_straight(double length, Lines* lines);
/// Adds a spring as a coil of this radius [m] with straight ends.
void add_coil(double length, double radius, Lines* lines);
void stretch(double factor, Lines* lines);

// Points of a TRIANGLE_LIST along z from the origin, of length and radius 1.
/// Adds a piston in a sleeve between two discs; the sleeve's bottom is at z = 1.
void add_strut(Lines* triangles);
/// Adds a bolt with a right-handed or left-handed thread.
void add_thread(bool is_right, Lines* triangles);

}  // namespace constraint_sim
