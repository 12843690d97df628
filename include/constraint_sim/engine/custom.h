#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace constraint_sim::engine {

// Constraints and forces of other packages, as joints of kinds kCustom and kCustomForce. A joint
// names a registered type and gives its parameters; scenes, snapshots and the state hash hold both.
// Functions are called several times a step and from several threads: they are const, keep no
// memory, and return the same result for the same arguments. A function that throws or returns a
// number that is not finite fails the step with Failure::kCustom and the name of the joint.

/// Frames of a joint on bodies A and B in world axes, or rates of the frames, or derivatives with
/// respect to the frames. Where A is the world, d is a position and `axes_A` is constant.
struct FramePair {
  Eigen::Vector3d d = Eigen::Vector3d::Zero();  ///< from anchor A to anchor B [m]
  /// Columns: the axes x, y, z of each frame [1]. Both frames have equal axes when the joint is
  /// added.
  Eigen::Matrix3d axes_A = Eigen::Matrix3d::Zero(), axes_B = Eigen::Matrix3d::Zero();
};

/// A scalar equation C = 0 between two bodies [m], smooth near its solutions, as a function of 21
/// numbers. Methods that conserve energy evaluate it at means of two poses too, where the axes are
/// no rotation.
class CustomConstraint {
 public:
  virtual ~CustomConstraint() = default;
  virtual double value(const FramePair& at) const = 0;
  /// Returns ∂C/∂z for each number z of `at`. Where all derivatives are 0 the constraint has no
  /// force.
  virtual FramePair gradient(const FramePair& at) const = 0;
  /// Returns γ = żᵀ(∇²C)ż for rates ż: C̈ without accelerations [m/s²].
  virtual double gamma(const FramePair& at, const FramePair& rates) const = 0;
};

/// Force and torque on B at anchor B, world axes. A gets the opposite of both at anchor A.
struct CustomWrench {
  Eigen::Vector3d force = Eigen::Vector3d::Zero();   ///< [N]
  Eigen::Vector3d torque = Eigen::Vector3d::Zero();  ///< [N m]
};

/// A force between two bodies as a smooth function of time [s], pose and rates. Methods that
/// advance by impulses evaluate the force once, at the start of a step.
class CustomForce {
 public:
  virtual ~CustomForce() = default;
  virtual CustomWrench wrench(double t, const FramePair& at, const FramePair& rates) const = 0;
};

struct CustomParameter {
  std::string name;
  double value = 0.0;
};
/// Parameters sorted by name, each name once.
using CustomParameters = std::vector<CustomParameter>;

/// Makes the functions of a joint. Throws std::invalid_argument for invalid parameters.
using CustomConstraintFactory =
    std::function<std::shared_ptr<const CustomConstraint>(const CustomParameters&)>;
using CustomForceFactory =
    std::function<std::shared_ptr<const CustomForce>(const CustomParameters&)>;

/// Registers a type for this process and replaces a type with the same name. Existing joints keep
/// their functions. Throws std::invalid_argument for a name that a body could not have.
void register_custom_constraint(const std::string& type, CustomConstraintFactory factory);
void register_custom_force(const std::string& type, CustomForceFactory factory);
/// Names of all types, sorted.
std::vector<std::string> custom_types();

class CustomCode;

/// Type and parameters of a joint of kind kCustom or kCustomForce.
struct CustomElement {
  std::string type;                        ///< name of a registered type
  CustomParameters parameters;             ///< any order; sorted when the joint is added
  std::shared_ptr<const CustomCode> code;  ///< set when the joint is added
};

}  // namespace constraint_sim::engine
