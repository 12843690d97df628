#pragma once

#include <array>
#include <memory>
#include <stdexcept>
#include <string>

#include "constraint_sim/engine/custom.h"
#include "constraint_sim/engine/joint.h"
#include "engine/constraints/joint_vectors.h"
#include "engine/model/jacobian.h"

namespace constraint_sim::engine {

/// A function of another package threw, or returned a number that is not finite.
struct CustomFailure : std::invalid_argument {
  CustomFailure(std::string joint, const std::string& why)
      : std::invalid_argument("custom: " + why), joint_name(std::move(joint)) {}
  std::string joint_name;
};

/// Functions of a custom joint, with its name and type for error messages.
class CustomCode {
 public:
  CustomCode(std::string joint_name, std::string type,
             std::shared_ptr<const CustomConstraint> constraint,
             std::shared_ptr<const CustomForce> force);

  double value(const JointVectors& vectors) const;
  Jacobian jacobian(const JointVectors& vectors) const;
  double rate(const JointVectors& vectors, const JointMotion& motion) const;
  double gamma(const JointVectors& vectors, const JointMotion& motion) const;
  FramePair gradient(const JointVectors& vectors) const;
  /// Discrete gradient of Gonzalez, on the bodies: times their motion from start to end it is the
  /// change of C.
  Jacobian discrete_gradient(const JointVectors& start, const JointVectors& end) const;
  /// Wrench in the layout of a Jacobian: force and torque about the centres of A and of B.
  Jacobian wrench(double t, const JointVectors& vectors, const JointMotion& motion) const;
  /// Throws where gradient or γ contradict the value near this pose.
  void check(const JointVectors& vectors) const;

 private:
  template <class Call>
  auto call(const char* function, Call evaluate) const;
  [[noreturn]] void fail(const std::string& why) const;
  FramePair gradient_at(const FramePair& at) const;

  std::string joint_name_, type_;
  std::shared_ptr<const CustomConstraint> constraint_;
  std::shared_ptr<const CustomForce> force_;
};

/// Sorts the parameters and makes the functions of a custom joint. Throws std::invalid_argument
/// naming the type or the parameter.
void make_custom_code(Joint* joint);

}  // namespace constraint_sim::engine
