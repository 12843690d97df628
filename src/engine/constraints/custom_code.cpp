// Constraints and forces of other packages. C is a function of z, the 21 numbers of d and of the
// axes of both frames. With ∂d = ∂x_B + ∂θ_B × r_B − ∂x_A − ∂θ_A × r_A and ∂a = ∂θ × a for an axis,
//   J = (−g, −r_A × g + Σ a × ∂C/∂a, g, r_B × g + Σ b × ∂C/∂b),  g = ∂C/∂d.

#include "engine/constraints/custom_code.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>
#include <utility>

#include "constraint_sim/engine/report.h"
#include "engine/math/numbers.h"
#include "engine/model/validate.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Step ε of central differences, times 1 + ‖d‖. Their error is ε² C''' by truncation, and grows as
// 1/ε by rounding.
constexpr double kStep = 1e-5;
constexpr double kSlopesAgree = 1e-6;
// Least product of the size of a joint and the slope of C that derivatives are compared with, in
// units of C: differences of flatter functions show rounding.
constexpr double kLeastChange = 1e-6;

struct Factories {
  CustomConstraintFactory constraint;
  CustomForceFactory force;
};

struct Registry {
  std::mutex mutex;
  std::map<std::string, Factories> types;
};

Registry& registry() {
  static Registry all;
  return all;
}

void add_type(const std::string& type, Factories factories) {
  check_name("type", type);
  if (!factories.constraint && !factories.force)
    refuse("type", in_quotes(type) + " has no factory");
  const std::lock_guard<std::mutex> lock(registry().mutex);
  registry().types[type] = std::move(factories);
}

FramePair frames(const JointVectors& v) { return {v.d, v.axes_A, v.axes_B}; }

Matrix3d turned(const Vector3d& w, const Matrix3d& axes) {
  Matrix3d rates;
  for (int k = 0; k < 3; ++k) rates.col(k) = w.cross(Vector3d(axes.col(k)));
  return rates;
}

FramePair rates_of(const JointVectors& v, const JointMotion& motion) {
  return {motion.d_dot, turned(motion.w_A, v.axes_A), turned(motion.w_B + motion.spin, v.axes_B)};
}

double product(const FramePair& a, const FramePair& b) {
  return a.d.dot(b.d) + a.axes_A.cwiseProduct(b.axes_A).sum() +
         a.axes_B.cwiseProduct(b.axes_B).sum();
}

// Returns a + share b.
FramePair sum(const FramePair& a, double share, const FramePair& b) {
  return {a.d + share * b.d, a.axes_A + share * b.axes_A, a.axes_B + share * b.axes_B};
}

Vector3d moment(const Matrix3d& axes, const Matrix3d& gradient) {
  Vector3d total = Vector3d::Zero();
  for (int k = 0; k < 3; ++k) total += Vector3d(axes.col(k)).cross(Vector3d(gradient.col(k)));
  return total;
}

Jacobian on_bodies(const JointVectors& v, const FramePair& g) {
  Jacobian J;
  J.j1 = -g.d;
  J.j2 = moment(v.axes_A, g.axes_A) - v.r_A.cross(g.d);
  J.j3 = g.d;
  J.j4 = moment(v.axes_B, g.axes_B) + v.r_B.cross(g.d);
  return J;
}

bool is_finite(double number) { return std::isfinite(number); }
bool is_finite(const FramePair& z) {
  return z.d.allFinite() && z.axes_A.allFinite() && z.axes_B.allFinite();
}
bool is_finite(const CustomWrench& wrench) {
  return wrench.force.allFinite() && wrench.torque.allFinite();
}

/// Returns a FramePair with 1 for the number `index` of 21, and 0 for the others.
FramePair unit(int index) {
  FramePair z;
  if (index < 3)
    z.d[index] = 1.0;
  else if (index < 12)
    z.axes_A(index - 3) = 1.0;
  else
    z.axes_B(index - 12) = 1.0;
  return z;
}

std::string part(int index) {
  const auto entry = [](int i) {
    return std::string(1, static_cast<char>('x' + i / 3)) + "[" + std::to_string(i % 3) + "]";
  };
  if (index < 3) return "d[" + std::to_string(index) + "]";
  return index < 12 ? "axes_A." + entry(index - 3) : "axes_B." + entry(index - 12);
}

}  // namespace

void register_custom_constraint(const std::string& type, CustomConstraintFactory factory) {
  add_type(type, {std::move(factory), nullptr});
}

void register_custom_force(const std::string& type, CustomForceFactory factory) {
  add_type(type, {nullptr, std::move(factory)});
}

std::vector<std::string> custom_types() {
  const std::lock_guard<std::mutex> lock(registry().mutex);
  std::vector<std::string> names;
  for (const auto& [name, factories] : registry().types) names.push_back(name);
  return names;
}

CustomCode::CustomCode(std::string joint_name, std::string type,
                       std::shared_ptr<const CustomConstraint> constraint,
                       std::shared_ptr<const CustomForce> force)
    : joint_name_(std::move(joint_name)),
      type_(std::move(type)),
      constraint_(std::move(constraint)),
      force_(std::move(force)) {}

void CustomCode::fail(const std::string& why) const {
  throw CustomFailure(joint_name_,
                      in_quotes(joint_name_) + " of type " + in_quotes(type_) + ": " + why);
}

template <class Call>
auto CustomCode::call(const char* function, Call evaluate) const {
  decltype(evaluate()) result;
  try {
    result = evaluate();
  } catch (const std::exception& thrown) {
    fail(std::string(function) + " threw: " + thrown.what());
  } catch (...) {
    fail(std::string(function) + " threw");
  }
  if (!is_finite(result)) fail(std::string(function) + " is not finite");
  return result;
}

FramePair CustomCode::gradient(const JointVectors& vectors) const {
  return gradient_at(frames(vectors));
}

FramePair CustomCode::gradient_at(const FramePair& at) const {
  return call("gradient", [&] { return constraint_->gradient(at); });
}

double CustomCode::value(const JointVectors& vectors) const {
  const double C = call("value", [&] { return constraint_->value(frames(vectors)); });
  if (std::abs(C) > kMostMagnitude) fail("value " + shortest(C) + " is beyond 1e20");
  return C;
}

Jacobian CustomCode::jacobian(const JointVectors& vectors) const {
  return on_bodies(vectors, gradient(vectors));
}

double CustomCode::rate(const JointVectors& vectors, const JointMotion& motion) const {
  return product(gradient(vectors), rates_of(vectors, motion));
}

// Adds ∇C · z̈ of axes and arms that turn at constant rates to the γ of the function.
double CustomCode::gamma(const JointVectors& vectors, const JointMotion& motion) const {
  const FramePair at = frames(vectors), rates = rates_of(vectors, motion);
  const Vector3d w_B = motion.w_B + motion.spin;
  FramePair bias{motion.d_bias, turned(motion.w_A, rates.axes_A), turned(w_B, rates.axes_B)};
  bias.axes_B += turned(motion.spin_bias, vectors.axes_B);
  return call("gamma", [&] { return constraint_->gamma(at, rates); }) +
         product(gradient_at(at), bias);
}

// Returns ∇C at the mean, corrected along the change so that the product with the change is the
// change of C (Gonzalez, J. Nonlinear Sci. 6 (1996) 449).
Jacobian CustomCode::discrete_gradient(const JointVectors& start, const JointVectors& end) const {
  const JointVectors mean = between(start, end, 0.5);
  const FramePair change = sum(frames(end), -1.0, frames(start));
  FramePair g = gradient(mean);
  const double square = product(change, change);
  const double missed = value(end) - value(start) - product(g, change);
  // A smaller error is rounding of the two values; divided by a short change it would grow.
  const double rounding = 8.0 * kEpsilon * std::sqrt(product(g, g)) * (1.0 + mean.d.norm());
  if (std::abs(missed) > rounding) g = sum(g, missed / square, change);
  return on_bodies(mean, g);
}

Jacobian CustomCode::wrench(double t, const JointVectors& vectors,
                            const JointMotion& motion) const {
  const CustomWrench w =
      call("wrench", [&] { return force_->wrench(t, frames(vectors), rates_of(vectors, motion)); });
  Jacobian sum;
  sum.j1 = -w.force;
  sum.j2 = -w.torque - vectors.r_A.cross(w.force);
  sum.j3 = w.force;
  sum.j4 = w.torque + vectors.r_B.cross(w.force);
  return sum;
}

// Compares the gradient with central differences of C, and γ with central differences of the
// gradient.
void CustomCode::check(const JointVectors& vectors) const {
  if (force_ != nullptr) {
    wrench(0.0, vectors, JointMotion());
    return;
  }
  const FramePair at = frames(vectors);
  const auto value_at = [&](const FramePair& z) {
    return call("value", [&] { return constraint_->value(z); });
  };
  value(vectors);  // is within its bound, or fails
  const FramePair g = gradient_at(at);
  const double size = 1.0 + at.d.norm();
  const double step = kStep * size;
  const double slope = std::max(std::sqrt(product(g, g)), std::abs(value_at(at)) / size);
  const auto agrees = [&](double given, double found) {
    return std::abs(given - found) <= kSlopesAgree * std::max(kLeastChange, size * slope);
  };
  for (int i = 0; i < 21; ++i) {
    const FramePair direction = unit(i);
    const double found =
        (value_at(sum(at, step, direction)) - value_at(sum(at, -step, direction))) / (2.0 * step);
    const double given = product(g, direction);
    if (!agrees(given, found))
      fail("the gradient by " + part(i) + " is " + shortest(given) +
           ", but finite differences of the value give " + shortest(found));
  }
  for (int i = 0; i < 21; ++i) {
    for (int j = 0; j <= i; ++j) {
      const FramePair rates = i == j ? unit(i) : sum(unit(i), 1.0, unit(j));
      const FramePair change =
          sum(gradient_at(sum(at, step, rates)), -1.0, gradient_at(sum(at, -step, rates)));
      const double found = product(change, rates) / (2.0 * step);
      const double given = call("gamma", [&] { return constraint_->gamma(at, rates); });
      if (std::abs(given - found) <= kSlopesAgree * std::max({1.0, slope, std::abs(found)}))
        continue;
      fail("gamma for a rate of 1 of " + part(i) + (i == j ? "" : " and " + part(j)) + " is " +
           shortest(given) + ", but finite differences of the gradient give " + shortest(found));
    }
  }
}

void make_custom_code(Joint* joint) {
  CustomElement& custom = joint->custom;
  auto& parameters = custom.parameters;
  std::sort(parameters.begin(), parameters.end(),
            [](const auto& a, const auto& b) { return a.name < b.name; });
  for (std::size_t i = 0; i < parameters.size(); ++i) {
    check_name("parameters", parameters[i].name);
    check_finite(parameters[i].name.c_str(), parameters[i].value);
    if (i > 0 && parameters[i - 1].name == parameters[i].name)
      refuse("parameters", in_quotes(parameters[i].name) + " is there twice");
  }
  Factories factories;
  {
    const std::lock_guard<std::mutex> lock(registry().mutex);
    const auto found = registry().types.find(custom.type);
    if (found != registry().types.end()) factories = found->second;
  }
  const bool is_force = joint->kind == JointKind::kCustomForce;
  if (is_force ? !factories.force : !factories.constraint) {
    std::string known;
    for (const std::string& type : custom_types()) known += (known.empty() ? "" : ", ") + type;
    refuse("custom", std::string("no plugin has a ") + (is_force ? "force" : "constraint") +
                         " of type " + in_quotes(custom.type) +
                         "; types are: " + (known.empty() ? "none" : known));
  }
  std::shared_ptr<const CustomConstraint> constraint;
  std::shared_ptr<const CustomForce> force;
  try {
    if (is_force)
      force = factories.force(parameters);
    else
      constraint = factories.constraint(parameters);
  } catch (const std::exception& thrown) {
    refuse("custom",
           in_quotes(joint->name) + " of type " + in_quotes(custom.type) + ": " + thrown.what());
  }
  if (constraint == nullptr && force == nullptr)
    refuse("custom", in_quotes(custom.type) + " has made nothing");
  custom.code = std::make_shared<const CustomCode>(joint->name, custom.type, std::move(constraint),
                                                   std::move(force));
}

}  // namespace constraint_sim::engine
