#pragma once

// Reference for a tree of links with a fixed root in minimal coordinates: recursive Newton-Euler
// (Featherstone, Rigid Body Dynamics Algorithms, chapter 5) on the URDF's own links, lumped or not,
// integrated by the classical Runge-Kutta method. Shares no code with the engine.

#include <Eigen/Dense>
#include <cmath>
#include <vector>

#include "urdf/parse.h"

namespace constraint_sim {

class TreeReference {
 public:
  TreeReference(const urdf::ModelInterface& model, const Eigen::Vector3d& gravity)
      : gravity_(gravity) {
    add(*model.getRoot(), -1, nullptr);
  }

  std::vector<std::string> names() const { return names_; }

  /// Returns q̈ from M(q) q̈ = −damping − RNEA(q, q̇, 0).
  Eigen::VectorXd acceleration(const Eigen::VectorXd& q, const Eigen::VectorXd& v) const {
    const Eigen::Index n = q.size();
    const Eigen::VectorXd zero = Eigen::VectorXd::Zero(n);
    const Eigen::VectorXd rest = inverse_dynamics(q, v, zero, gravity_);
    Eigen::MatrixXd M(n, n);
    for (Eigen::Index i = 0; i < n; ++i)
      M.col(i) = inverse_dynamics(q, zero, Eigen::VectorXd::Unit(n, i), Eigen::Vector3d::Zero());
    Eigen::VectorXd torque = -rest;
    for (Eigen::Index i = 0; i < n; ++i) torque[i] -= damping_[static_cast<std::size_t>(i)] * v[i];
    return M.ldlt().solve(torque);
  }

  /// Takes one step of length h.
  void step(double h, Eigen::VectorXd* q, Eigen::VectorXd* v) const {
    const Eigen::VectorXd q0 = *q, v0 = *v;
    const Eigen::VectorXd a1 = acceleration(q0, v0);
    const Eigen::VectorXd v2 = v0 + 0.5 * h * a1;
    const Eigen::VectorXd a2 = acceleration(q0 + 0.5 * h * v0, v2);
    const Eigen::VectorXd v3 = v0 + 0.5 * h * a2;
    const Eigen::VectorXd a3 = acceleration(q0 + 0.5 * h * v2, v3);
    const Eigen::VectorXd v4 = v0 + h * a3;
    const Eigen::VectorXd a4 = acceleration(q0 + h * v3, v4);
    *q = q0 + h / 6.0 * (v0 + 2.0 * v2 + 2.0 * v3 + v4);
    *v = v0 + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
  }

  /// Returns the poses of all links in the world's frame, in the order of link_names().
  std::vector<Eigen::Isometry3d> frames(const Eigen::VectorXd& q) const {
    std::vector<Eigen::Isometry3d> frames;
    for (const Link& link : links_) {
      if (link.parent < 0) {
        frames.push_back(Eigen::Isometry3d::Identity());
        continue;
      }
      Eigen::Isometry3d frame = frames[at(link.parent)] * link.origin;
      if (link.coordinate >= 0 && link.is_prismatic)
        frame = frame * Eigen::Translation3d(q[link.coordinate] * link.axis);
      else if (link.coordinate >= 0)
        frame = frame * Eigen::AngleAxisd(q[link.coordinate], link.axis);
      frames.push_back(frame);
    }
    return frames;
  }
  std::vector<std::string> link_names() const {
    std::vector<std::string> names;
    for (const Link& link : links_) names.push_back(link.name);
    return names;
  }

 private:
  struct Link {
    std::string name;
    int parent;
    int coordinate = -1;  // -1: fixed
    bool is_prismatic = false;
    Eigen::Isometry3d origin = Eigen::Isometry3d::Identity();
    Eigen::Vector3d axis = Eigen::Vector3d::UnitX();
    double mass = 0.0;
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();  // about the centre of mass, link axes
  };

  static std::size_t at(int i) { return static_cast<std::size_t>(i); }

  void add(const urdf::Link& given, int parent, const urdf::Joint* joint) {
    Link link;
    link.name = given.name;
    link.parent = parent;
    if (joint != nullptr) {
      link.origin = to_isometry(joint->parent_to_joint_origin_transform);
      link.is_prismatic = joint->type == urdf::Joint::PRISMATIC;
      if (joint->type != urdf::Joint::FIXED) {
        link.axis = to_eigen(joint->axis).normalized();
        link.coordinate = static_cast<int>(names_.size());
        names_.push_back(joint->name);
        damping_.push_back(joint->dynamics ? joint->dynamics->damping : 0.0);
      }
    }
    if (given.inertial) {
      const urdf::Inertial& i = *given.inertial;
      const Eigen::Isometry3d at = to_isometry(i.origin);
      Eigen::Matrix3d inertia;
      inertia << i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz;
      link.mass = i.mass;
      link.centre = at.translation();
      link.inertia = at.linear() * inertia * at.linear().transpose();
    }
    const int index = static_cast<int>(links_.size());
    links_.push_back(link);
    for (const auto& child_joint : given.child_joints)
      for (const auto& child : given.child_links)
        if (child->name == child_joint->child_link_name) add(*child, index, child_joint.get());
  }

  /// Returns the torques for an acceleration; gravity enters as an upward acceleration of the root.
  Eigen::VectorXd inverse_dynamics(const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                                   const Eigen::VectorXd& a, const Eigen::Vector3d& gravity) const {
    const std::vector<Eigen::Isometry3d> X = frames(q);
    const std::size_t count = links_.size();
    const Eigen::Vector3d zero = Eigen::Vector3d::Zero();
    std::vector<Eigen::Vector3d> w(count, zero), dw(count, zero), acc(count, -gravity);
    std::vector<Eigen::Vector3d> f(count, zero), n(count, zero);
    for (std::size_t i = 0; i < count; ++i) {
      const Link& link = links_[i];
      if (link.parent >= 0) {
        const std::size_t p = at(link.parent);
        const Eigen::Vector3d r = X[i].translation() - X[p].translation();
        w[i] = w[p];
        dw[i] = dw[p];
        acc[i] = acc[p] + dw[p].cross(r) + w[p].cross(w[p].cross(r));
        if (link.coordinate >= 0) {
          const Eigen::Vector3d s = X[i].linear() * link.axis;
          const double rate = v[link.coordinate], change = a[link.coordinate];
          if (link.is_prismatic) {
            acc[i] += 2.0 * rate * w[p].cross(s) + change * s;
          } else {
            w[i] += rate * s;
            dw[i] += change * s + rate * w[p].cross(s);
          }
        }
      }
      const Eigen::Vector3d c = X[i].linear() * link.centre;
      const Eigen::Matrix3d I = X[i].linear() * link.inertia * X[i].linear().transpose();
      f[i] = link.mass * (acc[i] + dw[i].cross(c) + w[i].cross(w[i].cross(c)));
      n[i] = I * dw[i] + w[i].cross(I * w[i]) + c.cross(f[i]);
    }
    Eigen::VectorXd torque = Eigen::VectorXd::Zero(q.size());
    for (std::size_t i = count; i-- > 1;) {
      const Link& link = links_[i];
      if (link.coordinate >= 0) {
        const Eigen::Vector3d s = X[i].linear() * link.axis;
        torque[link.coordinate] = s.dot(link.is_prismatic ? f[i] : n[i]);
      }
      const std::size_t p = at(link.parent);
      const Eigen::Vector3d r = X[i].translation() - X[p].translation();
      f[p] += f[i];
      n[p] += n[i] + r.cross(f[i]);
    }
    return torque;
  }

  Eigen::Vector3d gravity_;
  std::vector<Link> links_;
  std::vector<std::string> names_;
  std::vector<double> damping_;
};

}  // namespace constraint_sim
