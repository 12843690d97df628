#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace constraint_sim::engine {

// Constraints and forces of other packages, as joints of kinds kCustom and kCustomForce. A type has
// a name and a factory; a joint has the name of a type and parameters, which are what scenes,
// snapshots and the state hash hold. Functions are called several times a step and from several
// threads: const, without memory, the same result for the same arguments. What they throw, or a
// result that is not finite, fails the step (Failure::kCustom) and names the joint.

/// The frames of a joint on bodies A and B in world axes, or rates of these, or derivatives by
/// these. With the world for A, d is a position and `axes_A` are constant.
struct FramePair {
  Eigen::Vector3d d = Eigen::Vector3d::Zero();  ///< from anchor A to anchor B [m]
  /// Columns: the axes x, y, z of the frames [1]. As the joint is added, those of B are those of A.
  Eigen::Matrix3d axes_A = Eigen::Matrix3d::Zero(), axes_B = Eigen::Matrix3d::Zero();
};

/// One equation C = 0 between two bodies [m], smooth near where it holds. It is a function of 21
/// numbers: methods that conserve energy also ask at means of two poses, whose axes are no
/// rotation.
class CustomConstraint {
 public:
  virtual ~CustomConstraint() = default;
  virtual double value(const FramePair& at) const = 0;
  /// ∂C by each number of `at`. Where all of them are 0 the constraint has no force.
  virtual FramePair gradient(const FramePair& at) const = 0;
  /// γ = żᵀ(∇²C)ż for rates ż: C̈ where nothing accelerates [m/s²].
  virtual double gamma(const FramePair& at, const FramePair& rates) const = 0;
};

/// On B at its anchor; A has the opposite of both at its own anchor. World axes.
struct CustomWrench {
  Eigen::Vector3d force = Eigen::Vector3d::Zero();   ///< [N]
  Eigen::Vector3d torque = Eigen::Vector3d::Zero();  ///< [N m]
};

/// A force between two bodies as a smooth function of time [s], pose and rates. Where impulses
/// advance the bodies it is evaluated once, at the start of a step.
class CustomForce {
 public:
  virtual ~CustomForce() = default;
  virtual CustomWrench wrench(double t, const FramePair& at, const FramePair& rates) const = 0;
};

struct CustomParameter {
  std::string name;
  double value = 0.0;
};
/// Sorted by name, each name once.
using CustomParameters = std::vector<CustomParameter>;

/// Makes the functions of one joint. Throws std::invalid_argument for parameters that cannot be.
using CustomConstraintFactory =
    std::function<std::shared_ptr<const CustomConstraint>(const CustomParameters&)>;
using CustomForceFactory =
    std::function<std::shared_ptr<const CustomForce>(const CustomParameters&)>;

/// Makes a type known to this process, instead of one with the same name. Joints that are there
/// keep their functions. Names as those of bodies; throws std::invalid_argument for others.
void register_custom_constraint(const std::string& type, CustomConstraintFactory factory);
void register_custom_force(const std::string& type, CustomForceFactory factory);
/// Names of all types, sorted.
std::vector<std::string> custom_types();

class CustomCode;

/// What a joint of kind kCustom or kCustomForce has of its own.
struct CustomElement {
  std::string type;                        ///< as it was registered
  CustomParameters parameters;             ///< any order; sorted when the joint is added
  std::shared_ptr<const CustomCode> code;  ///< set when the joint is added
};

}  // namespace constraint_sim::engine
