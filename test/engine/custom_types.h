#pragma once

// Constraints and forces as in a plugin of another package.

#include <cmath>
#include <memory>
#include <stdexcept>

#include "constraint_sim/engine/custom.h"

namespace constraint_sim::engine::example_types {

using Eigen::Vector3d;

inline double parameter(const CustomParameters& all, const char* name) {
  for (const CustomParameter& one : all)
    if (one.name == name) return one.value;
  throw std::invalid_argument(std::string("parameters: '") + name + "' is left out");
}

/// A rod: ½(d·d − ℓ²) where `squared` is 1, else ‖d‖ − ℓ.
struct Rod : CustomConstraint {
  double length;
  bool is_squared;
  Rod(double length, bool is_squared) : length(length), is_squared(is_squared) {}

  double value(const FramePair& at) const override {
    return is_squared ? 0.5 * (at.d.squaredNorm() - length * length) : at.d.norm() - length;
  }
  FramePair gradient(const FramePair& at) const override {
    FramePair g;
    g.d = is_squared ? at.d : Vector3d(at.d.normalized());
    return g;
  }
  double gamma(const FramePair& at, const FramePair& rates) const override {
    if (is_squared) return rates.d.squaredNorm();
    const Vector3d n = at.d.normalized();
    return (rates.d.squaredNorm() - std::pow(n.dot(rates.d), 2)) / at.d.norm();
  }
};

/// z_A·z_B = 0: the row of a universal joint beside its point, dimensionless.
struct RightAngle : CustomConstraint {
  double value(const FramePair& at) const override {
    return at.axes_A.col(2).dot(at.axes_B.col(2));
  }
  FramePair gradient(const FramePair& at) const override {
    FramePair g;
    g.axes_A.col(2) = at.axes_B.col(2);
    g.axes_B.col(2) = at.axes_A.col(2);
    return g;
  }
  double gamma(const FramePair& /*at*/, const FramePair& rates) const override {
    return 2.0 * rates.axes_A.col(2).dot(rates.axes_B.col(2));
  }
};

/// B is in the bowl z = k (x² + y²)² of A, which is no polynomial of degree two.
struct Bowl : CustomConstraint {
  double k;
  double gradient_factor = 1.0, gamma_factor = 1.0;  // 1 is correct
  explicit Bowl(double k) : k(k) {}

  double value(const FramePair& at) const override {
    return at.d.z() - k * std::pow(at.d.head<2>().squaredNorm(), 2);
  }
  FramePair gradient(const FramePair& at) const override {
    FramePair g;
    g.d << -gradient_factor * 4.0 * k * at.d.head<2>().squaredNorm() * at.d.head<2>(), 1.0;
    return g;
  }
  double gamma(const FramePair& at, const FramePair& rates) const override {
    const auto r = at.d.head<2>(), v = rates.d.head<2>();
    return -gamma_factor * 4.0 * k *
           (2.0 * std::pow(r.dot(v), 2) + r.squaredNorm() * v.squaredNorm());
  }
};

/// Drag −c (ḋ − w), with wind w along x.
struct Drag : CustomForce {
  double c, wind;
  Drag(double c, double wind) : c(c), wind(wind) {}

  CustomWrench wrench(double /*t*/, const FramePair& /*at*/,
                      const FramePair& rates) const override {
    return {-c * (rates.d - wind * Vector3d::UnitX()), Vector3d::Zero()};
  }
};

/// A force f cos(ω t) along x, and an equal torque about z.
struct Shaker : CustomForce {
  double f, omega;
  Shaker(double f, double omega) : f(f), omega(omega) {}

  CustomWrench wrench(double t, const FramePair& /*at*/,
                      const FramePair& /*rates*/) const override {
    return {f * std::cos(omega * t) * Vector3d::UnitX(),
            f * std::cos(omega * t) * Vector3d::UnitZ()};
  }
};

/// A plane x = 0 whose function ends at x = 1.
struct EndingPlane : CustomConstraint {
  double value(const FramePair& at) const override { return at.d.x() > 1.0 ? NAN : at.d.x(); }
  FramePair gradient(const FramePair& at) const override {
    FramePair g;
    g.d.x() = at.d.x() > 1.0 ? NAN : 1.0;
    return g;
  }
  double gamma(const FramePair& /*at*/, const FramePair& /*rates*/) const override { return 0.0; }
};

/// Fails from a time on: throws, or returns NaN where `throws` is 0.
struct Faulty : CustomForce {
  double from;
  bool throws;
  Faulty(double from, bool throws) : from(from), throws(throws) {}

  CustomWrench wrench(double t, const FramePair& /*at*/,
                      const FramePair& /*rates*/) const override {
    if (t < from) return {};
    if (throws) throw std::runtime_error("the sensor is gone");
    return {Vector3d(NAN, 0.0, 0.0), Vector3d::Zero()};
  }
};

inline void register_all() {
  register_custom_constraint("test/rod", [](const CustomParameters& p) {
    return std::make_shared<Rod>(parameter(p, "length"), parameter(p, "squared") != 0.0);
  });
  register_custom_constraint("test/right_angle", [](const CustomParameters& /*p*/) {
    return std::make_shared<RightAngle>();
  });
  register_custom_constraint("test/bowl", [](const CustomParameters& p) {
    const auto bowl = std::make_shared<Bowl>(parameter(p, "k"));
    if (p.size() > 1) {
      bowl->gradient_factor = parameter(p, "gradient_factor");
      bowl->gamma_factor = parameter(p, "gamma_factor");
    }
    return bowl;
  });
  register_custom_constraint(
      "test/ending", [](const CustomParameters& /*p*/) { return std::make_shared<EndingPlane>(); });
  register_custom_force("test/drag", [](const CustomParameters& p) {
    return std::make_shared<Drag>(parameter(p, "c"), parameter(p, "wind"));
  });
  register_custom_force("test/shaker", [](const CustomParameters& p) {
    return std::make_shared<Shaker>(parameter(p, "f"), parameter(p, "omega"));
  });
  register_custom_force("test/faulty", [](const CustomParameters& p) {
    return std::make_shared<Faulty>(parameter(p, "from"), parameter(p, "throws") != 0.0);
  });
}

}  // namespace constraint_sim::engine::example_types
