#pragma once

// A scene as every engine can build it, with the motion it should have. Knows no engine.

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <vector>

namespace constraint_sim::report {

/// Of one body, world axes. `position` is its centre of mass.
struct State {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();               ///< [m]
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();  ///< body to world
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();               ///< [m/s]
  Eigen::Vector3d angular_velocity = Eigen::Vector3d::Zero();       ///< [rad/s]
};
using States = std::vector<State>;       ///< of all bodies at one time
using Trajectory = std::vector<States>;  ///< one entry a sample, the first at time 0

enum class Shape { kPoint, kSphere, kBox, kPlane };  ///< a plane is solid below its z axis

struct Body {
  double mass = 1.0;                                  ///< [kg]; not of what does not move
  bool is_static = false;                             ///< never moves
  Eigen::Vector3d inertia = Eigen::Vector3d::Zero();  ///< principal [kg m²]; zero: a point mass
  State start;
  Shape shape = Shape::kPoint;
  Eigen::Vector3d size = Eigen::Vector3d::Zero();  ///< edges, or the radius in x [m]
  double friction = 0.0;                           ///< Coulomb's coefficient, alike on all bodies
  double restitution = 0.0;
  Eigen::Vector3d force = Eigen::Vector3d::Zero();  ///< constant, at the centre [N]
};

/// Those from kHinge on keep axes, and have the names that scenes have for them. A free length is
/// nothing but the distance of two points, for a pulley; with an upper limit it is a rope.
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
/// As in scenes; nullptr of one without axes.
const char* name(JointKind kind);
inline constexpr int kWorld = -1;

/// Between points of two bodies. Rods and springs are as long as at the start unless `length` says
/// otherwise.
struct Joint {
  JointKind kind = JointKind::kRod;
  int a = kWorld;
  int b = 0;
  Eigen::Vector3d anchor_a = Eigen::Vector3d::Zero();  ///< in the body's frame, or the world's [m]
  Eigen::Vector3d anchor_b = Eigen::Vector3d::Zero();
  /// Of joints with axes; z is that about or along which they move, of planes the normal.
  Eigen::Quaterniond frame_a = Eigen::Quaterniond::Identity();
  Eigen::Quaterniond frame_b = Eigen::Quaterniond::Identity();
  double length = -1.0;    ///< [m]; < 0: as at the start
  double stiffness = 0.0;  ///< of a spring [N/m]
  double rate = 0.0;       ///< a rod's motor: its length grows so fast [m/s]
  double max_force = 0.0;  ///< of the motor [N]; 0: no limit
  /// Of a rod, so much pull or push breaks it [N]; 0: none.
  double break_force = 0.0;
  /// Limits of what a slider [m], hinge [rad] or free length [m] has free, the first two 0 at the
  /// start, and the share of the speed it is thrown back with. A motor there has a force limit and
  /// holds the coordinate at `rate`; of a rope it is a winch, which moves the limit.
  double lower = -std::numeric_limits<double>::infinity();
  double upper = std::numeric_limits<double>::infinity();
  double restitution = 0.0;
  double friction = 0.0;  ///< Coulomb's, along that [N or N m]

  bool is_limited() const { return std::isfinite(lower) || std::isfinite(upper); }
  bool is_rope() const { return kind == JointKind::kFreeLength && std::isfinite(upper); }
  /// Whether anything of it acts one way, or up to a limit only.
  bool has_law() const {
    return is_limited() || friction > 0.0 || max_force > 0.0 || break_force > 0.0;
  }
};

/// q₁ + ratio q₂ stays what it is at the start: of a gear or a rack the coordinates of a hinge or
/// slider each, of a pulley two free lengths, of a screw the translation and the angle of one
/// cylindrical joint, which both ends name.
struct Coupling {
  int first = 0;  ///< joint
  int second = 0;
  double ratio = 1.0;  ///< unit of q₁ per unit of q₂

  bool is_screw() const { return first == second; }
  /// Of a screw [m a turn].
  double pitch() const { return -2.0 * 3.14159265358979323846 * ratio; }
};

struct Problem {
  std::string name;
  /// What it shows: smooth, stiff, contact, mechanism, event; or a row of the stability grid.
  std::string group;
  bool is_graded = true;  ///< in work-precision diagrams; else in the stability grid only
  Eigen::Vector3d gravity{0.0, 0.0, -9.81};  ///< [m/s²]
  std::vector<Body> bodies;
  std::vector<Joint> joints;
  std::vector<Coupling> couplings{};
  double duration = 1.0;        ///< [s]
  double sample = 0.1;          ///< errors are taken at multiples of this [s]
  double tick_scale = 1.0;      ///< ticks of the stability grid are multiplied by it
  double length = 1.0;          ///< the size of the scene: errors are judged against it [m]
  bool is_planar = true;        ///< moves in the x-z plane only: joint coordinates may use hinges
  std::vector<int> measured{};  ///< bodies whose position and orientation count; empty: all
  bool is_invalid = false;      ///< no engine should accept it
  bool has_conflict = false;    ///< its joints cannot all be met: their error says nothing
  bool is_conservative = true;  ///< energy should stay
  int warm_up = 0;              ///< samples before run times count; memory is that until then
  std::string source;           ///< where the reference comes from; empty: there is none
  /// The motion, computed with steps `refinement` times as short where there are steps.
  std::function<Trajectory(int refinement)> reference;

  int samples() const;  ///< after the start
  bool has_shapes() const;
  /// That couples the coordinates of this joint with each other; nullptr where none does.
  const Coupling* screw_of(std::size_t joint) const;
};

/// All that problems/*.cpp registered, by name. The order of files does not matter.
const std::vector<Problem>& problems();
/// One of them, or of a kind that exists in every size: `KIND_COUNT`.
const Problem& problem_named(const std::string& name);

/// At namespace scope in a file of problems/: adds what `make` returns.
struct Registration {
  explicit Registration(std::vector<Problem> (*make)());
  /// A kind of scene of any size. It is made where its name is asked for and not among problems().
  Registration(const std::string& kind, Problem (*make)(int count));
};

}  // namespace constraint_sim::report
