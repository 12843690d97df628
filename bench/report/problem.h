#pragma once

// A scene that every engine can build, with the motion it should have. Independent of all engines.

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <vector>

namespace constraint_sim::report {

/// State of one body in the world's axes; `position` is its centre of mass.
struct State {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();               ///< [m]
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();  ///< body to world
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();               ///< [m/s]
  Eigen::Vector3d angular_velocity = Eigen::Vector3d::Zero();       ///< [rad/s]
};
using States = std::vector<State>;       ///< all bodies at one time
using Trajectory = std::vector<States>;  ///< one entry per sample, the first at time 0

enum class Shape { kPoint, kSphere, kBox, kPlane };  ///< a plane is solid below its z axis

struct Body {
  double mass = 1.0;                                  ///< [kg]; unused for static bodies
  bool is_static = false;                             ///< never moves
  Eigen::Vector3d inertia = Eigen::Vector3d::Zero();  ///< principal [kg m²]; zero: a point mass
  State start;
  Shape shape = Shape::kPoint;
  Eigen::Vector3d size = Eigen::Vector3d::Zero();  ///< edges, or the radius in x [m]
  double friction = 0.0;                           ///< Coulomb's coefficient, equal on all bodies
  double restitution = 0.0;
  Eigen::Vector3d force = Eigen::Vector3d::Zero();  ///< constant, at the centre [N]
};

/// Kinds of joints. Those from kHinge on keep axes, and have the names of scenes. A free length is
/// the distance of two points without a constraint, for a pulley; with an upper limit it is a rope.
enum class JointKind {
  kRod,
  kBall,
  kSpring,
  kFreeLength,
  kHinge,
  kSlider,
  kCylindrical,
  kPlanar,
  kUniversal,
  kWeld,
  kPointOnLine,
  kPointOnPlane
};
inline bool has_axes(JointKind kind) { return kind >= JointKind::kHinge; }
/// Returns the name in scenes; nullptr for kinds without axes.
const char* name(JointKind kind);
inline constexpr int kWorld = -1;

/// A joint between points of two bodies. Rods and springs have their initial length unless `length`
/// is set.
struct Joint {
  JointKind kind = JointKind::kRod;
  int a = kWorld;
  int b = 0;
  Eigen::Vector3d anchor_a = Eigen::Vector3d::Zero();  ///< frame of the body or world [m]
  Eigen::Vector3d anchor_b = Eigen::Vector3d::Zero();
  /// Frames of joints with axes; z is the axis of motion, of planes the normal.
  Eigen::Quaterniond frame_a = Eigen::Quaterniond::Identity();
  Eigen::Quaterniond frame_b = Eigen::Quaterniond::Identity();
  double length = -1.0;    ///< [m]; < 0: initial length
  double stiffness = 0.0;  ///< stiffness of a spring [N/m]
  double rate = 0.0;       ///< motor of a rod: rate of its length [m/s]
  double max_force = 0.0;  ///< force limit of the motor [N]; 0: no limit
  /// Tension or compression that breaks a rod [N]; 0: none.
  double break_force = 0.0;
  /// Limits of the coordinate of a slider [m], hinge [rad] or free length [m], 0 at the start for
  /// the first two, and restitution there. A motor with a force limit holds the coordinate at
  /// `rate`; the motor of a rope is a winch, which moves the limit.
  double lower = -std::numeric_limits<double>::infinity();
  double upper = std::numeric_limits<double>::infinity();
  double restitution = 0.0;
  double friction = 0.0;  ///< Coulomb friction along the coordinate [N or N m]

  bool is_limited() const { return std::isfinite(lower) || std::isfinite(upper); }
  bool is_rope() const { return kind == JointKind::kFreeLength && std::isfinite(upper); }
  /// Returns whether the joint has one-sided elements or force limits.
  bool has_law() const {
    return is_limited() || friction > 0.0 || max_force > 0.0 || break_force > 0.0;
  }
};

/// A coupling keeps q₁ + ratio q₂ constant: of a gear or rack the coordinates of hinges or sliders,
/// of a pulley two free lengths, of a screw translation and angle of one cylindrical joint, which
/// both ends name.
struct Coupling {
  int first = 0;  ///< joint
  int second = 0;
  double ratio = 1.0;  ///< unit of q₁ per unit of q₂

  bool is_screw() const { return first == second; }
  /// Returns the pitch of a screw [m a turn].
  double pitch() const { return -2.0 * 3.14159265358979323846 * ratio; }
};

struct Problem {
  std::string name;
  /// Class of the problem: smooth, stiff, contact, mechanism, event; or a row of the stability
  /// grid.
  std::string group;
  bool is_graded = true;  ///< shown in work-precision diagrams, not only in the stability grid
  Eigen::Vector3d gravity{0.0, 0.0, -9.81};  ///< [m/s²]
  std::vector<Body> bodies;
  std::vector<Joint> joints;
  std::vector<Coupling> couplings{};
  double duration = 1.0;    ///< [s]
  double sample = 0.1;      ///< errors are evaluated at multiples of this time [s]
  double tick_scale = 1.0;  ///< factor for the ticks of the stability grid
  double length = 1.0;      ///< size of the scene, the scale of errors [m]
  /// Radius of gyration of point masses in engines that divide by their inertia [m]; negligible
  /// beside the lengths of the scene.
  double point_gyration = 1e-6;
  bool is_planar = true;        ///< moves in the x-z plane only: joint coordinates may use hinges
  std::vector<int> measured{};  ///< bodies whose position and orientation count; empty: all
  bool is_invalid = false;      ///< every engine should reject it
  bool has_conflict = false;    ///< joints contradict each other: their error is meaningless
  bool is_conservative = true;  ///< energy should be constant
  int warm_up = 0;     ///< samples before run times count; memory is what is allocated until then
  std::string source;  ///< source of the reference; empty: none
  /// Returns the motion, computed with steps divided by `refinement` where there are steps.
  std::function<Trajectory(int refinement)> reference;

  int samples() const;  ///< number of samples after the start
  bool has_shapes() const;
  /// Returns the coupling of a screw joint; nullptr where there is none.
  const Coupling* screw_of(std::size_t joint) const;
};

/// Returns all problems registered by problems/*.cpp, sorted by name, so the order of files does
/// not matter.
const std::vector<Problem>& problems();
/// Returns a problem by name, or by `KIND_COUNT` for kinds that exist in every size.
const Problem& problem_named(const std::string& name);

/// Registers problems: a global in a file of problems/ adds the result of `make`.
struct Registration {
  explicit Registration(std::vector<Problem> (*make)());
  /// Registers a kind of any size. It is made when its name is requested, and not listed by
  /// problems().
  Registration(const std::string& kind, Problem (*make)(int count));
};

}  // namespace constraint_sim::report
