#pragma once

#include <geometry_msgs/Point.h>
#include <geometry_msgs/Quaternion.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

namespace constraint_sim {

/// Points of a LINE_LIST: each two are a line.
using Lines = std::vector<geometry_msgs::Point>;

/// Of places in a world, which are finite.
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

/// Turns z to this direction (unit).
Eigen::Quaterniond turn_of_z(const Eigen::Vector3d& direction);

/// kDashes of them, as far apart as they are long.
inline constexpr int kDashes = 8;
void add_dashes(const Eigen::Vector3d& from, const Eigen::Vector3d& to, Lines* lines);
void add_line(const Eigen::Vector3d& from, const Eigen::Vector3d& to, Lines* lines);
/// An arrow of this length [m] along a direction (unit), with a head of that length at most, seen
/// from all sides.
void add_arrow(const Eigen::Vector3d& from, const Eigen::Vector3d& along, double length,
               double head, Lines* lines);
/// Three quarters of a circle about z, at this height, with a head where it ends; clockwise seen
/// against z where not `positive`.
void add_turning_arrow(double radius, double z, bool positive, Lines* lines);
/// A whole circle about a point, from u towards v, which are as long as its radius.
void add_circle(const Eigen::Vector3d& middle, const Eigen::Vector3d& u, const Eigen::Vector3d& v,
                Lines* lines);
/// A wheel about z at this height: its teeth reach half of their depth out of the radius.
void add_toothed_wheel(double radius, double depth, int teeth, double z, Lines* lines);
/// A row of teeth, each of this width, that reach out by `depth`.
void add_teeth(const Eigen::Vector3d& from, const Eigen::Vector3d& to, const Eigen::Vector3d& depth,
               double width, Lines* lines);
/// The diagonals of a cube with this half edge.
void add_cross(double half, Lines* lines);
/// A square of the x-y plane with a cross in it, and arrows at the ends of that where `has_arrows`.
void add_sheet(double half, bool has_arrows, Lines* lines);
/// A rope of this length from the origin to a point, which hangs through along `down` (unit) where
/// it is longer than their distance: kRopeParts lines, in place of what was there.
inline constexpr int kRopeParts = 16;
void set_rope(const Eigen::Vector3d& to, double length, const Eigen::Vector3d& down, Lines* lines);

// Along z from the origin, so that stretch() makes them longer.
/// A straight rope: kRopeParts lines.
void add_straight(double length, Lines* lines);
/// A spring as a coil of this radius [m] with straight ends.
void add_coil(double length, double radius, Lines* lines);
void stretch(double factor, Lines* lines);

// Along z from the origin, of length and radius 1: the points of a TRIANGLE_LIST.
/// A piston in a sleeve between two discs, whose bottom is at the end.
void add_strut(Lines* triangles);
/// A bolt with a thread, right-handed or left-handed.
void add_thread(bool is_right, Lines* triangles);

}  // namespace constraint_sim
