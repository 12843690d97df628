#pragma once

// A reference that shares no code with the engine: dense, in long double, index 1 with projection.
// Bodies and joints are read from the public structs alone.
//
//   A λ = −(G a + γ),  A = G M⁻¹ Gᵀ,  V̇ = a + M⁻¹ Gᵀ λ
//
// Dependent rows are left out by Cholesky's factorisation with diagonal pivots: what is left then
// holds them too. Steps are Gragg's, Bulirsch's and Stoer's, followed by a projection.

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "constraint_sim/engine/world.h"

namespace constraint_sim::engine::reference {

using Real = long double;
using Vector3 = Eigen::Matrix<Real, 3, 1>;
using Matrix3 = Eigen::Matrix<Real, 3, 3>;
using Quaternion = Eigen::Quaternion<Real>;
using VectorX = Eigen::Matrix<Real, Eigen::Dynamic, 1>;
using MatrixX = Eigen::Matrix<Real, Eigen::Dynamic, Eigen::Dynamic>;

/// Bodies, joints and forces as they are given to a World, in the order of their ids: joints name
/// body i by BodyId{i + 1}.
struct Scene {
  std::string kind;
  WorldOptions options;
  std::vector<Body> bodies;
  std::vector<Joint> joints;
  std::vector<Wrench> wrenches;  ///< constant from the start
};

inline bool is_spring(const Joint& joint) {
  const auto* distance = if_distance(joint);
  return distance != nullptr && distance->is_soft();
}

inline bool is_limit(const Joint& joint) {
  const auto* distance = if_distance(joint);
  return distance != nullptr && distance->is_limited();
}

struct Pose {
  Vector3 x, v, w;
  Quaternion q;
};

inline Pose pose_of(const BodyState& state, const Vector3& origin) {
  return {state.position.cast<Real>() - origin, state.linear_velocity.cast<Real>(),
          state.angular_velocity.cast<Real>(), state.orientation.cast<Real>().normalized()};
}

template <class Items>
auto& at(Items& items, int i) {
  return items[static_cast<std::size_t>(i)];
}

class Mechanics {
 public:
  explicit Mechanics(Scene scene) : scene_(std::move(scene)) {
    if (!scene_.bodies.empty()) origin_ = scene_.bodies[0].state.position.cast<Real>();
    for (const Body& body : scene_.bodies) {
      start_.push_back(pose_of(body.state, origin_));
      Vector3 inertia = body.inertia.cast<Real>();
      const Real mass = static_cast<Real>(body.mass);
      const auto* box = std::get_if<Box>(&body.shape);
      const auto* sphere = std::get_if<Sphere>(&body.shape);
      if (inertia.isZero(0) && box != nullptr) {
        const Vector3 s = box->size.cast<Real>().cwiseAbs2();
        inertia = mass / 12 * Vector3(s.y() + s.z(), s.z() + s.x(), s.x() + s.y());
      } else if (inertia.isZero(0) && sphere != nullptr) {
        const Real r = static_cast<Real>(sphere->radius);
        inertia.setConstant(mass * r * r * 2 / 5);
      }
      const bool moves = body.type == BodyType::kDynamic;
      inertia_.push_back(moves ? inertia : Vector3(0, 0, 0));
      inverse_mass_.push_back(moves ? 1 / static_cast<Real>(body.mass) : 0);
    }
  }

  const Scene& scene() const { return scene_; }
  const std::vector<Pose>& start() const { return start_; }
  /// Positions of poses count from here, so that far scenes lose no digits: the first body's start.
  const Vector3& origin() const { return origin_; }

  /// Where a body that nothing pulls at is: what is kinematic keeps its twist.
  std::vector<Pose> start_at(Real t) const {
    std::vector<Pose> poses = start_;
    for (std::size_t i = 0; i < poses.size(); ++i) place_kinematic(i, t, &poses[i]);
    return poses;
  }

  /// Radius of gyration [m].
  double radius(std::size_t i) const {
    return static_cast<double>(std::sqrt(inertia_[i].maxCoeff() * inverse_mass_[i]));
  }

  /// ∫ζ, ζ and ζ̇ of a joint's motor.
  struct Travel {
    Real s, rate, acceleration;
  };
  static Travel travel(const Motor& motor, Real t) {
    const Real a = static_cast<Real>(motor.amplitude), phase = static_cast<Real>(motor.phase);
    const Real omega = 2 * std::acos(Real{-1}) * static_cast<Real>(motor.frequency);
    Travel travel{static_cast<Real>(motor.bias) * t, static_cast<Real>(motor.bias), 0};
    if (a == 0) return travel;
    travel.rate += a * std::sin(omega * t + phase);
    travel.acceleration = a * omega * std::cos(omega * t + phase);
    travel.s += omega > 0 ? a * (std::cos(phase) - std::cos(omega * t + phase)) / omega
                          : a * std::sin(phase) * t;
    return travel;
  }

  /// By how much a joint is off at time t [m]; of limits, beyond them; 0 of springs.
  Real joint_error(const Joint& joint, const std::vector<Pose>& poses, Real t) const {
    const Ends e = ends(joint, poses);
    const Real d = e.d.norm();
    const auto* distance = if_distance(joint);
    if (distance == nullptr) return further_error(joint, e, poses);
    if (distance->is_soft()) return 0;
    const Real s = travel(joint.motor, t).s;
    if (!distance->is_limited()) return std::abs(d - static_cast<Real>(*distance->length) - s);
    return std::max(
        {Real{0}, d - static_cast<Real>(distance->max_length) - s,
         distance->min_length > 0 ? static_cast<Real>(distance->min_length) + s - d : Real{0}});
  }

  /// Smallest of the pivots that are kept, of rows scaled to 1: sin² of the angle between a row and
  /// those before it, in the metric of the masses.
  double smallest_pivot(const std::vector<Pose>& poses, Real t) const {
    return static_cast<double>(Factors(matrix(poses, make_rows(poses, t))).smallest_pivot());
  }

  /// Largest error of a joint, and whose it is.
  std::pair<double, std::size_t> worst_joint(const std::vector<Pose>& poses, double t) const {
    std::pair<double, std::size_t> worst{0.0, 0};
    for (std::size_t j = 0; j < scene_.joints.size(); ++j) {
      const auto error =
          static_cast<double>(joint_error(scene_.joints[j], poses, static_cast<Real>(t)));
      if (!(error <= worst.first)) worst = {error, j};
    }
    return worst;
  }

  struct Energy {
    double kinetic = 0.0, potential = 0.0;
  };
  Energy energy(const std::vector<Pose>& poses) const {
    Real kinetic = 0, potential = 0;
    for (std::size_t i = 0; i < poses.size(); ++i) {
      if (inverse_mass_[i] == 0) continue;
      const Vector3 w = poses[i].q.conjugate() * poses[i].w;
      kinetic += (poses[i].v.squaredNorm() / inverse_mass_[i] + inertia_[i].dot(w.cwiseAbs2())) / 2;
      potential -= gravity().dot(poses[i].x - start_[i].x) / inverse_mass_[i];
    }
    for (const Joint& joint : scene_.joints) {
      if (!is_spring(joint)) continue;
      const auto& spring = joint.distance;
      const Real stretch = ends(joint, poses).d.norm() - static_cast<Real>(*spring.length);
      potential += static_cast<Real>(spring.stiffness) * stretch * stretch / 2;
    }
    return {static_cast<double>(kinetic), static_cast<double>(potential)};
  }

  // ---- motion

  /// Rows from which all others follow, at a pose that fits. Within a step they must not change:
  /// between its ends poses do not fit, and there what depends on them contradicts them.
  std::vector<Eigen::Index> independent_rows(const std::vector<Pose>& poses, Real t) const {
    return Factors(matrix(poses, make_rows(poses, t))).kept();
  }

  /// `v` and `w` of the result are accelerations.
  std::vector<Pose> accelerations(const std::vector<Pose>& poses, Real t,
                                  const std::vector<Eigen::Index>& kept) const {
    const std::vector<Row> all = make_rows(poses, t);
    std::vector<Row> rows;
    for (const Eigen::Index r : kept) rows.push_back(all[static_cast<std::size_t>(r)]);
    std::vector<Pose> a = poses;
    for (std::size_t i = 0; i < poses.size(); ++i) {
      a[i].v.setZero();
      a[i].w.setZero();
      if (inverse_mass_[i] == 0) continue;
      a[i].v = gravity();
      const Vector3 w = poses[i].q.conjugate() * poses[i].w;
      a[i].w =
          inverse_inertia_times(i, poses[i].q, poses[i].q * -w.cross(inertia_[i].cwiseProduct(w)));
    }
    add_forces(poses, &a);
    VectorX b(static_cast<Eigen::Index>(rows.size()));
    for (std::size_t r = 0; r < rows.size(); ++r)
      b[static_cast<Eigen::Index>(r)] = -rows[r].times(a) - rows[r].gamma;
    respond(poses, rows, Factors(matrix(poses, rows)).solve(b), &a);
    return a;
  }

  /// Makes positions and velocities fit the joints, by the least change in the metric of the
  /// masses. Returns the largest error left [m], of all joints.
  Real project(Real t, std::vector<Pose>* poses) const {
    for (int k = 0; k < 4; ++k) {
      const std::vector<Row> rows = make_rows(*poses, t);
      if (rows.empty()) return 0;
      VectorX b(static_cast<Eigen::Index>(rows.size()));
      for (std::size_t r = 0; r < rows.size(); ++r) b[static_cast<Eigen::Index>(r)] = -rows[r].C;
      std::vector<Pose> change = *poses;
      for (Pose& pose : change) pose.v = pose.w = Vector3(0, 0, 0);
      const Factors factors(matrix(*poses, rows));
      respond(*poses, rows, factors.solve(b), &change);
      Real largest = 0;
      for (std::size_t i = 0; i < poses->size(); ++i) {
        (*poses)[i].x += change[i].v;
        turn(change[i].w, &(*poses)[i].q);
        largest = std::max({largest, change[i].v.norm(), change[i].w.norm()});
      }
      if (largest < 1e-17L) break;
    }
    const std::vector<Row> rows = make_rows(*poses, t);
    VectorX b(static_cast<Eigen::Index>(rows.size()));
    for (std::size_t r = 0; r < rows.size(); ++r)
      b[static_cast<Eigen::Index>(r)] = rows[r].target - rows[r].times(*poses);
    respond(*poses, rows, Factors(matrix(*poses, rows)).solve(b), poses);
    return error_left(*poses, t, rows);
  }

  static void turn(const Vector3& by, Quaternion* q) {
    const Real angle = by.norm();
    if (angle == 0) return;
    const Vector3 axis = by / angle;
    *q = Quaternion(Eigen::AngleAxis<Real>(angle, axis)) * *q;
    q->normalize();
  }

  bool is_movable(std::size_t i) const { return inverse_mass_[i] != 0; }

  void place_kinematic(std::size_t i, Real t, Pose* pose) const {
    if (scene_.bodies[i].type != BodyType::kKinematic) return;
    pose->x = start_[i].x + t * start_[i].v;
    pose->q = start_[i].q;
    turn(t * start_[i].w, &pose->q);
  }

 private:
  struct Ends {
    int a, b;  // -1: the world
    Vector3 r_A, r_B, d;
  };
  struct Row {
    int a, b;
    Vector3 v_A, w_A, v_B, w_B;
    Real C = 0, target = 0, gamma = 0;

    Real times(const std::vector<Pose>& twists) const {
      Real sum = 0;
      if (a >= 0) sum += v_A.dot(at(twists, a).v) + w_A.dot(at(twists, a).w);
      if (b >= 0) sum += v_B.dot(at(twists, b).v) + w_B.dot(at(twists, b).w);
      return sum;
    }
  };

  /// Cholesky with diagonal pivots of the matrix scaled to a unit diagonal, until they are
  /// rounding.
  class Factors {
   public:
    explicit Factors(MatrixX A) : scale_(A.diagonal()), L_(std::move(A)) {
      constexpr Real kDependent = 1e-13L;
      const Eigen::Index n = L_.rows();
      for (Eigen::Index i = 0; i < n; ++i) scale_[i] = scale_[i] > 0 ? 1 / std::sqrt(scale_[i]) : 0;
      L_ = scale_.asDiagonal() * L_ * scale_.asDiagonal();
      order_.resize(static_cast<std::size_t>(n));
      for (Eigen::Index i = 0; i < n; ++i) order_[static_cast<std::size_t>(i)] = i;
      for (; rank_ < n; ++rank_) {
        Eigen::Index best = 0;
        if (L_.diagonal().tail(n - rank_).maxCoeff(&best) < kDependent) break;
        swap(rank_, rank_ + best);
        smallest_pivot_ = std::min(smallest_pivot_, L_(rank_, rank_));
        L_(rank_, rank_) = std::sqrt(L_(rank_, rank_));
        const Eigen::Index left = n - rank_ - 1;
        L_.col(rank_).tail(left) /= L_(rank_, rank_);
        for (Eigen::Index k = rank_ + 1; k < n; ++k) {
          const Real factor = L_(k, rank_);
          if (factor != 0) L_.col(k).tail(n - k) -= factor * L_.col(rank_).tail(n - k);
        }
      }
    }
    Real smallest_pivot() const { return smallest_pivot_; }
    std::vector<Eigen::Index> kept() const { return {order_.begin(), order_.begin() + rank_}; }
    VectorX solve(const VectorX& b) const {
      VectorX x = VectorX::Zero(b.size());
      if (rank_ == 0) return x;
      VectorX y(rank_);
      for (Eigen::Index i = 0; i < rank_; ++i) y[i] = scale_[at(i)] * b[at(i)];
      const auto L = L_.topLeftCorner(rank_, rank_).template triangularView<Eigen::Lower>();
      L.solveInPlace(y);
      L.transpose().solveInPlace(y);
      for (Eigen::Index i = 0; i < rank_; ++i) x[at(i)] = scale_[at(i)] * y[i];
      return x;
    }

   private:
    Eigen::Index at(Eigen::Index i) const { return order_[static_cast<std::size_t>(i)]; }
    // rows and columns of a matrix of which the lower triangle counts
    void swap(Eigen::Index i, Eigen::Index k) {
      if (i == k) return;
      const Eigen::Index n = L_.rows();
      L_.row(i).head(i).swap(L_.row(k).head(i));
      std::swap(L_(i, i), L_(k, k));
      for (Eigen::Index j = i + 1; j < k; ++j) std::swap(L_(j, i), L_(k, j));
      for (Eigen::Index j = k + 1; j < n; ++j) std::swap(L_(j, i), L_(j, k));
      std::swap(order_[static_cast<std::size_t>(i)], order_[static_cast<std::size_t>(k)]);
    }

    VectorX scale_;
    Real smallest_pivot_ = 1;
    MatrixX L_;
    std::vector<Eigen::Index> order_;
    Eigen::Index rank_ = 0;
  };

  Vector3 gravity() const { return scene_.options.gravity.cast<Real>(); }

  Vector3 inverse_inertia_times(std::size_t i, const Quaternion& q, const Vector3& torque) const {
    Vector3 t = q.conjugate() * torque;
    for (int k = 0; k < 3; ++k) t[k] = inertia_[i][k] > 0 ? t[k] / inertia_[i][k] : 0;
    return q * t;
  }

  Ends ends(const Joint& joint, const std::vector<Pose>& poses) const {
    Ends e{static_cast<int>(joint.body_a.value) - 1, static_cast<int>(joint.body_b.value) - 1,
           joint.anchor_a.cast<Real>(), joint.anchor_b.cast<Real>(), Vector3(0, 0, 0)};
    e.r_A = e.a >= 0 ? at(poses, e.a).q * e.r_A : Vector3(e.r_A - origin_);
    e.r_B = e.b >= 0 ? at(poses, e.b).q * e.r_B : Vector3(e.r_B - origin_);
    const Vector3 x_A = e.a >= 0 ? at(poses, e.a).x : Vector3(0, 0, 0);
    const Vector3 x_B = e.b >= 0 ? at(poses, e.b).x : Vector3(0, 0, 0);
    e.d = (x_B - x_A) + (e.r_B - e.r_A);
    return e;
  }

  /// A vector of a joint: fixed in A (0) or B (1), the separation d (2), or constant (3); with its
  /// rate, and its second derivative without accelerations.
  struct Vector {
    Vector3 value, rate, gamma;
    int fixed_in;
  };

  static Vector axis(const Quaternion& frame, int k, const std::vector<Pose>& poses, int body,
                     int fixed_in) {
    const Vector3 u = frame * Vector3(Vector3::Unit(k));
    if (body < 0) return {u, Vector3(0, 0, 0), Vector3(0, 0, 0), 3};
    const Vector3& w = at(poses, body).w;
    return {u, w.cross(u), w.cross(w.cross(u)), fixed_in};
  }

  /// u·v = 0.
  static Row product(const Ends& e, const Vector& u, const Vector& v) {
    const Vector3 zero(0, 0, 0);
    Row row{e.a, e.b, zero, zero, zero, zero};
    row.C = u.value.dot(v.value);
    row.gamma = u.gamma.dot(v.value) + 2 * u.rate.dot(v.rate) + u.value.dot(v.gamma);
    for (const auto& [moving, other] : {std::pair(&u, &v), std::pair(&v, &u)}) {
      const Vector3& n = other->value;
      const Vector3 turning = moving->value.cross(n);
      if (moving->fixed_in == 0) row.w_A += turning;
      if (moving->fixed_in == 1) row.w_B += turning;
      if (moving->fixed_in != 2) continue;
      row.v_A -= n;
      row.w_A -= e.r_A.cross(n);
      row.v_B += n;
      row.w_B += e.r_B.cross(n);
    }
    return row;
  }

  struct Frames {
    Quaternion A, B;
  };
  Frames frames(const Joint& joint, const Ends& e, const std::vector<Pose>& poses) const {
    Frames f{joint.frame_a.cast<Real>().normalized(),
             joint.frame_b.value_or(Eigen::Quaterniond::Identity()).cast<Real>().normalized()};
    if (e.a >= 0) f.A = at(poses, e.a).q * f.A;
    if (e.b >= 0) f.B = at(poses, e.b).q * f.B;
    return f;
  }

  /// Of every kind but kDistance.
  void add_rows(const Joint& joint, const Ends& e, const Vector& d, const std::vector<Pose>& poses,
                std::vector<Row>* rows) const {
    const Frames f = frames(joint, e, poses);
    const auto on_a = [&](int k) { return axis(f.A, k, poses, e.a, 0); };
    const auto on_b = [&](int k) { return axis(f.B, k, poses, e.b, 1); };
    const auto add = [&](const Vector& u, const Vector& v) { rows->push_back(product(e, u, v)); };
    const auto add_point = [&] {
      for (int k = 0; k < 3; ++k)
        add({Vector3(Vector3::Unit(k)), Vector3(0, 0, 0), Vector3(0, 0, 0), 3}, d);
    };
    const auto add_parallel = [&] {  // z_B along z_A
      add(on_a(0), on_b(2));
      add(on_a(1), on_b(2));
    };
    const auto add_line = [&] {
      add(on_a(0), d);
      add(on_a(1), d);
    };
    switch (joint.kind) {
      case JointKind::kDistance:
      case JointKind::kFreeDistance:
      case JointKind::kGear:  // couplings are held by bench/coupled_mechanisms.h
      case JointKind::kPulley:
      case JointKind::kScrew:
        break;
      case JointKind::kBall:
        return add_point();
      case JointKind::kHinge:
        add_point();
        return add_parallel();
      case JointKind::kUniversal:
        add_point();
        return add(on_a(2), on_b(2));
      case JointKind::kWeld:
        add_point();
        add_parallel();
        return add(on_a(1), on_b(0));
      case JointKind::kSlider:
        add_line();
        add_parallel();
        return add(on_a(1), on_b(0));
      case JointKind::kCylindrical:
        add_line();
        return add_parallel();
      case JointKind::kPlanar:
        add(on_a(2), d);
        return add_parallel();
      case JointKind::kPointOnLine:
        return add_line();
      case JointKind::kPointOnPlane:
        return add(on_a(2), d);
    }
  }

  /// The larger of the distance that has to be zero and of the angle times the radius of gyration.
  Real further_error(const Joint& joint, const Ends& e, const std::vector<Pose>& poses) const {
    const Frames f = frames(joint, e, poses);
    const Vector3 z_A = f.A * Vector3(0, 0, 1), z_B = f.B * Vector3(0, 0, 1);
    const Real along = z_A.dot(e.d);
    Real gap = e.d.norm(), angle = 0;
    const auto between = [&] { return std::atan2(z_A.cross(z_B).norm(), z_A.dot(z_B)); };
    switch (joint.kind) {
      case JointKind::kDistance:
      case JointKind::kBall:
        break;
      case JointKind::kFreeDistance:
      case JointKind::kGear:
      case JointKind::kPulley:
      case JointKind::kScrew:
        return 0;
      case JointKind::kHinge:
        angle = between();
        break;
      case JointKind::kUniversal:
        angle = std::abs(std::atan2(z_A.dot(z_B), z_A.cross(z_B).norm()));
        break;
      case JointKind::kSlider:
        gap = (e.d - along * z_A).norm();
        [[fallthrough]];
      case JointKind::kWeld: {
        const Quaternion q = f.A.conjugate() * f.B;
        angle = 2 * std::atan2(q.vec().norm(), std::abs(q.w()));
        break;
      }
      case JointKind::kCylindrical:
        gap = (e.d - along * z_A).norm();
        angle = between();
        break;
      case JointKind::kPlanar:
        gap = std::abs(along);
        angle = between();
        break;
      case JointKind::kPointOnLine:
        gap = (e.d - along * z_A).norm();
        break;
      case JointKind::kPointOnPlane:
        gap = std::abs(along);
        break;
    }
    double radius_of_ends = 0.0;
    for (const int i : {e.a, e.b})
      if (i >= 0 && is_movable(static_cast<std::size_t>(i)))
        radius_of_ends = std::max(radius_of_ends, radius(static_cast<std::size_t>(i)));
    return std::max(gap, static_cast<Real>(radius_of_ends) * angle);
  }

  std::vector<Row> make_rows(const std::vector<Pose>& poses, Real t) const {
    std::vector<Row> rows;
    for (const Joint& joint : scene_.joints) {
      if (is_spring(joint) || is_limit(joint)) continue;
      const Ends e = ends(joint, poses);
      Vector3 rate(0, 0, 0), gamma(0, 0, 0);
      const auto add_end = [&](int i, const Vector3& r, Real sign) {
        if (i < 0) return;
        const Vector3& w = at(poses, i).w;
        rate += sign * (at(poses, i).v + w.cross(r));
        gamma += sign * w.cross(w.cross(r));
      };
      add_end(e.a, e.r_A, -1);
      add_end(e.b, e.r_B, 1);
      const auto along = [&](const Vector3& n) {
        return Row{e.a, e.b, -n, -e.r_A.cross(n), n, e.r_B.cross(n)};
      };
      if (joint.kind != JointKind::kDistance) {
        add_rows(joint, e, {e.d, rate, gamma, 2}, poses, &rows);
        continue;
      }
      const Travel s = travel(joint.motor, t);
      const Real length = static_cast<Real>(*joint.distance.length) + s.s;
      Row row = along(e.d);
      row.C = (e.d.squaredNorm() - length * length) / 2;
      row.target = length * s.rate;
      row.gamma = rate.squaredNorm() + e.d.dot(gamma) - s.rate * s.rate - length * s.acceleration;
      rows.push_back(row);
    }
    return rows;
  }

  // the lower triangle of A
  MatrixX matrix(const std::vector<Pose>& poses, const std::vector<Row>& rows) const {
    const auto n = static_cast<Eigen::Index>(rows.size());
    MatrixX A = MatrixX::Zero(n, n);
    std::vector<std::vector<std::pair<Eigen::Index, bool>>> rows_of(poses.size());
    for (Eigen::Index r = 0; r < n; ++r) {
      const Row& row = rows[static_cast<std::size_t>(r)];
      for (const bool is_b : {false, true}) {
        const int i = is_b ? row.b : row.a;
        if (i < 0 || !is_movable(static_cast<std::size_t>(i))) continue;
        auto& others = at(rows_of, i);
        others.emplace_back(r, is_b);
        const Vector3 v = inverse_mass_[static_cast<std::size_t>(i)] * (is_b ? row.v_B : row.v_A);
        const Vector3 w = inverse_inertia_times(static_cast<std::size_t>(i), at(poses, i).q,
                                                is_b ? row.w_B : row.w_A);
        for (const auto& [k, k_is_b] : others) {
          const Row& other = rows[static_cast<std::size_t>(k)];
          A(r, k) += v.dot(k_is_b ? other.v_B : other.v_A) + w.dot(k_is_b ? other.w_B : other.w_A);
        }
      }
    }
    return A;
  }

  // adds M⁻¹ Gᵀ λ
  void respond(const std::vector<Pose>& poses, const std::vector<Row>& rows, const VectorX& lambda,
               std::vector<Pose>* twists) const {
    for (std::size_t r = 0; r < rows.size(); ++r) {
      const Row& row = rows[r];
      const Real l = lambda[static_cast<Eigen::Index>(r)];
      if (row.a >= 0) add_force(row.a, poses, l * row.v_A, l * row.w_A, twists);
      if (row.b >= 0) add_force(row.b, poses, l * row.v_B, l * row.w_B, twists);
    }
  }

  void add_force(int body, const std::vector<Pose>& poses, const Vector3& force,
                 const Vector3& torque, std::vector<Pose>* a) const {
    const auto i = static_cast<std::size_t>(body);
    if (!is_movable(i)) return;
    (*a)[i].v += inverse_mass_[i] * force;
    (*a)[i].w += inverse_inertia_times(i, poses[i].q, torque);
  }

  void add_forces(const std::vector<Pose>& poses, std::vector<Pose>* a) const {
    for (const Wrench& wrench : scene_.wrenches)
      add_force(static_cast<int>(wrench.body.value) - 1, poses, wrench.force.cast<Real>(),
                wrench.torque.cast<Real>(), a);
    for (const Joint& joint : scene_.joints) {
      if (!is_spring(joint)) continue;
      const auto& spring = joint.distance;
      const Ends e = ends(joint, poses);
      const Vector3 n = e.d.normalized();
      Real rate = 0;
      if (e.a >= 0) rate -= n.dot(at(poses, e.a).v + at(poses, e.a).w.cross(e.r_A));
      if (e.b >= 0) rate += n.dot(at(poses, e.b).v + at(poses, e.b).w.cross(e.r_B));
      const Vector3 f =
          (-static_cast<Real>(spring.stiffness) * (e.d.norm() - static_cast<Real>(*spring.length)) -
           static_cast<Real>(spring.damping) * rate) *
          n;
      if (e.a >= 0) add_force(e.a, poses, -f, -e.r_A.cross(f), a);
      if (e.b >= 0) add_force(e.b, poses, f, e.r_B.cross(f), a);
    }
  }

  // of positions, and of velocities in metres of a second
  Real error_left(const std::vector<Pose>& poses, Real t, const std::vector<Row>& rows) const {
    Real largest = 0;
    for (const Joint& joint : scene_.joints)
      if (!is_spring(joint) && !is_limit(joint))
        largest = std::max(largest, joint_error(joint, poses, t));
    for (const Row& row : rows) {
      const Real size = std::max(row.v_A.norm(), row.v_B.norm());
      if (size > 0) largest = std::max(largest, std::abs(row.times(poses) - row.target) / size);
    }
    return largest;
  }

  Scene scene_;
  Vector3 origin_ = Vector3(0, 0, 0);
  std::vector<Pose> start_;
  std::vector<Vector3> inertia_;
  std::vector<Real> inverse_mass_;
};

/// Largest difference of positions, and of rotations times the radius of gyration [m].
inline double difference(const Mechanics& mechanics, const std::vector<Pose>& a,
                         const std::vector<Pose>& b) {
  double largest = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double x = static_cast<double>((a[i].x - b[i].x).norm());
    const double angle = static_cast<double>(2 * (a[i].q.conjugate() * b[i].q).vec().norm());
    const double turned = mechanics.radius(i) > 0.0 ? mechanics.radius(i) * angle : 0.0;
    for (const double off : {x, turned})
      if (!(off <= largest)) largest = off;
  }
  return largest;
}

/// Carries a mechanism on, by steps of its own choice. Says by valid() when it is no longer to be
/// relied upon.
class Integrator {
 public:
  /// `tolerance` of one step [m]; `most_evaluations` until it gives up.
  Integrator(const Mechanics& mechanics, double tolerance, long most_evaluations, int columns = 8)
      : mechanics_(mechanics),
        tolerance_(static_cast<Real>(tolerance)),
        left_(most_evaluations),
        columns_(columns),
        poses_(mechanics.start_at(0)) {
    is_valid_ = mechanics_.project(0, &poses_) < kFits;
  }

  bool is_valid() const { return is_valid_; }
  long left() const { return left_; }  ///< evaluations
  std::vector<Pose>& poses() { return poses_; }
  const std::vector<Pose>& poses() const { return poses_; }

  void advance_to(double end) {
    const auto to = static_cast<Real>(end);
    while (is_valid_ && t_ < to) {
      const bool is_last = t_ + h_ * 1.0001L >= to;
      const Real h = is_last ? to - t_ : h_;
      auto [next, error] = step(h);
      for (const Pose& pose : next)
        if (!(pose.x.allFinite() && pose.q.coeffs().allFinite())) error = 1;
      const Real power = 1 / static_cast<Real>(2 * columns_ - 1);
      const Real factor =
          std::clamp(Real{0.8L} * std::pow(tolerance_ / std::max(error, Real{1e-30L}), power),
                     Real{0.2L}, Real{2});
      if (error > tolerance_) {
        h_ = h * std::min(factor, Real{0.7L});
      } else {
        t_ = is_last ? to : t_ + h;
        poses_ = std::move(next);
        for (std::size_t i = 0; i < poses_.size(); ++i)
          mechanics_.place_kinematic(i, t_, &poses_[i]);
        if (!(mechanics_.project(t_, &poses_) < kFits)) is_valid_ = false;
        if (!is_last || factor < 1) h_ = h * factor;
      }
      if (left_ <= 0 || h_ < 1e-9L) is_valid_ = false;
    }
  }

 private:
  static constexpr Real kFits = 1e-9L;

  // y' of a flat state, by the public functions
  struct Slope {
    Vector3 x, v, w;
    Eigen::Matrix<Real, 4, 1> q;
  };
  std::vector<Slope> slopes(const std::vector<Pose>& poses, Real t) {
    --left_;
    const std::vector<Pose> a = mechanics_.accelerations(poses, t, kept_);
    std::vector<Slope> s(poses.size());
    for (std::size_t i = 0; i < poses.size(); ++i) {
      const Quaternion w(0, poses[i].w.x(), poses[i].w.y(), poses[i].w.z());
      s[i] = {poses[i].v, a[i].v, a[i].w, (w * poses[i].q).coeffs() / 2};
    }
    return s;
  }
  static void add(Real h, const std::vector<Slope>& s, std::vector<Pose>* poses) {
    for (std::size_t i = 0; i < s.size(); ++i) {
      (*poses)[i].x += h * s[i].x;
      (*poses)[i].v += h * s[i].v;
      (*poses)[i].w += h * s[i].w;
      (*poses)[i].q.coeffs() += h * s[i].q;
    }
  }
  // a + factor (a − b)
  static void combine(const std::vector<Pose>& a, Real factor, std::vector<Pose>* b) {
    for (std::size_t i = 0; i < a.size(); ++i) {
      Pose& p = (*b)[i];
      p.x = a[i].x + factor * (a[i].x - p.x);
      p.v = a[i].v + factor * (a[i].v - p.v);
      p.w = a[i].w + factor * (a[i].w - p.w);
      p.q.coeffs() = a[i].q.coeffs() + factor * (a[i].q.coeffs() - p.q.coeffs());
    }
  }

  std::pair<std::vector<Pose>, Real> step(Real H) {
    std::vector<std::vector<Pose>> table;
    std::vector<Pose> second;
    kept_ = mechanics_.independent_rows(poses_, t_);
    const std::vector<Slope> first = slopes(poses_, t_);
    for (int j = 1; j <= columns_; ++j) {
      const int n = 2 * j;
      const Real h = H / static_cast<Real>(n);
      std::vector<Pose> before = poses_, now = poses_;
      add(h, first, &now);
      for (int k = 1; k < n; ++k) {
        add(2 * h, slopes(now, t_ + static_cast<Real>(k) * h), &before);
        std::swap(before, now);
      }
      add(h, slopes(now, t_ + H), &before);
      combine(now, -Real{1} / 2, &before);  // their mean
      table.push_back(std::move(before));
      for (int k = j - 2; k >= 0; --k) {
        const Real ratio = static_cast<Real>(j) / static_cast<Real>(k + 1);
        combine(table[static_cast<std::size_t>(k) + 1], 1 / (ratio * ratio - 1),
                &table[static_cast<std::size_t>(k)]);
      }
      if (j == columns_ - 1) second = table.front();
    }
    Real error = 0;
    for (std::size_t i = 0; i < second.size(); ++i) {
      const Pose& a = table.front()[i];
      error = std::max({error, (a.x - second[i].x).norm(), H * (a.v - second[i].v).norm()});
      if (mechanics_.is_movable(i) && mechanics_.radius(i) > 0.0)
        error = std::max(error, static_cast<Real>(mechanics_.radius(i)) *
                                    (a.q.coeffs() - second[i].q.coeffs()).norm());
    }
    return {table.front(), error};
  }

  const Mechanics& mechanics_;
  Real tolerance_;
  long left_;
  int columns_;
  std::vector<Pose> poses_;
  std::vector<Eigen::Index> kept_;
  Real t_ = 0, h_ = 0.01L;
  bool is_valid_ = true;
};

}  // namespace constraint_sim::engine::reference
