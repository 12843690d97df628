#pragma once

// Mechanics of a reference that shares no code with the engine: dense, in long double, index 1 with
// projection. Bodies and joints are read from the public structs alone.
//
//   A λ = −(G a + γ),  A = G M⁻¹ Gᵀ,  V̇ = a + M⁻¹ Gᵀ λ
//
// Cholesky factorisation with diagonal pivoting drops dependent rows, which the kept rows imply.

#include <optional>
#include <variant>

#include "reference_joints.h"

namespace constraint_sim::engine::reference {

inline Pose pose_of(const BodyState& state, const Vector3& origin) {
  return {state.position.cast<Real>() - origin, state.linear_velocity.cast<Real>(),
          state.angular_velocity.cast<Real>(), state.orientation.cast<Real>().normalized()};
}

/// Both coordinates of each coupling, with whole turns; zeros for other joints.
using Readings = std::vector<std::array<Real, 2>>;

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
    const std::size_t joints = scene_.joints.size();
    constant_.assign(joints, 0);
    readings_ = read(start_, Readings(joints, {0, 0}));
    for (std::size_t j = 0; j < joints; ++j) {
      const Joint& joint = scene_.joints[j];
      if (!info(joint.kind).couples) continue;
      constant_[j] = joint.coupling.value ? static_cast<Real>(*joint.coupling.value)
                                          : coupled(j, start_, readings_).C;
    }
  }

  const Scene& scene() const { return scene_; }
  const std::vector<Pose>& start() const { return start_; }
  const Readings& start_readings() const { return readings_; }
  /// Returns the origin of positions, the first body's start, so that distant scenes lose no
  /// digits.
  const Vector3& origin() const { return origin_; }

  /// Returns the initial poses, with kinematic bodies moved to time t by their twist.
  std::vector<Pose> start_at(Real t) const {
    std::vector<Pose> poses = start_;
    for (std::size_t i = 0; i < poses.size(); ++i) place_kinematic(i, t, &poses[i]);
    return poses;
  }

  /// Returns the radius of gyration [m].
  double radius(std::size_t i) const {
    return static_cast<double>(std::sqrt(inertia_[i].maxCoeff() * inverse_mass_[i]));
  }

  /// Motion of a joint's motor: ∫ζ, ζ and ζ̇.
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

  /// Returns coupled coordinates, with angles nearest to the expected ones.
  Readings read(const std::vector<Pose>& poses, const Readings& expected) const {
    Readings now = expected;
    for (std::size_t j = 0; j < now.size(); ++j)
      for (std::size_t k = 0; info(scene_.joints[j].kind).couples && k < 2; ++k)
        now[j][k] = read(terms_of(scene_.joints, j)[k], poses, expected[j][k]).C;
    return now;
  }
  /// Advances coupled coordinates by h, with the mean of the rates at both ends.
  Readings read_on(const std::vector<Pose>& from, const std::vector<Pose>& to, Real h,
                   Readings readings) const {
    for (std::size_t j = 0; j < readings.size(); ++j) {
      for (std::size_t k = 0; info(scene_.joints[j].kind).couples && k < 2; ++k) {
        const Term term = terms_of(scene_.joints, j)[k];
        for (const auto* poses : {&from, &to})
          readings[j][k] += h / 2 * read(term, *poses, 0).times(*poses);
      }
    }
    return read(to, readings);
  }

  /// Chooses the whole turns that satisfy the couplings best, where an angle has moved too far to
  /// be unwrapped. Returns whether all turns are known.
  bool choose_turns(const std::vector<Pose>& poses, const Readings& before, Readings* now) const {
    constexpr Real kMostCounted = 2;  // [rad]
    bool are_known = true;
    const Real turn = 2 * std::acos(Real{-1});
    for (std::size_t j = 0; j < now->size(); ++j) {
      if (!info(scene_.joints[j].kind).couples) continue;
      const std::array<Term, 2> terms = terms_of(scene_.joints, j);
      std::array<int, 2> most{};
      for (std::size_t k = 0; k < 2; ++k)
        if (is_angle(scene_.joints[terms[k].joint], terms[k].which) &&
            std::abs((*now)[j][k] - before[j][k]) > kMostCounted)
          most[k] = 3;
      are_known = are_known && most[0] == 0 && most[1] == 0;
      const std::array<Real, 2> counted = (*now)[j];
      Real least = std::abs(coupled(j, poses, *now).C);
      for (int first = -most[0]; first <= most[0]; ++first) {
        for (int second = -most[1]; second <= most[1]; ++second) {
          Readings other = *now;
          other[j] = {counted[0] + turn * static_cast<Real>(first),
                      counted[1] + turn * static_cast<Real>(second)};
          const Real off = std::abs(coupled(j, poses, other).C);
          if (!(off < least)) continue;
          least = off;
          *now = other;
        }
      }
    }
    return are_known;
  }

  /// Returns the error of a joint at time t [m]: beyond limits, 0 for springs, and for a coupling
  /// in the unit of its first coordinate.
  Real joint_error(std::size_t j, const std::vector<Pose>& poses, Real t,
                   const Readings& before) const {
    const Joint& joint = scene_.joints[j];
    const Placed p(joint, poses, origin_);
    const auto* distance = if_distance(joint);
    if (distance == nullptr) {
      const Real off = info(joint.kind).couples ? std::abs(coupled(j, poses, before).C) : 0;
      return std::max(off, error_of(joint.kind, p, static_cast<Real>(radius_of_ends(p))));
    }
    if (distance->is_soft()) return 0;
    const Real d = p.d.value.norm(), s = travel(joint.motor, t).s;
    if (!distance->is_limited()) return std::abs(d - static_cast<Real>(*distance->length) - s);
    return std::max(
        {Real{0}, d - static_cast<Real>(distance->max_length) - s,
         distance->min_length > 0 ? static_cast<Real>(distance->min_length) + s - d : Real{0}});
  }

  /// Returns the smallest kept pivot of rows scaled to 1: sin² of the angle between a row and those
  /// before it, in the metric of the masses.
  double smallest_pivot(const std::vector<Pose>& poses, Real t) const {
    return static_cast<double>(
        DenseFactors(matrix(poses, make_rows(poses, t, readings_))).smallest_pivot());
  }

  /// Returns the largest error of a joint, and its index.
  std::pair<double, std::size_t> worst_joint(const std::vector<Pose>& poses, double t) const {
    return worst_joint(poses, t, readings_);
  }
  std::pair<double, std::size_t> worst_joint(const std::vector<Pose>& poses, double t,
                                             const Readings& before) const {
    std::pair<double, std::size_t> worst{0.0, 0};
    for (std::size_t j = 0; j < scene_.joints.size(); ++j) {
      const auto error = static_cast<double>(joint_error(j, poses, static_cast<Real>(t), before));
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
      const Real stretch =
          Placed(joint, poses, origin_).d.value.norm() - static_cast<Real>(*spring.length);
      potential += static_cast<Real>(spring.stiffness) * stretch * stretch / 2;
    }
    return {static_cast<double>(kinetic), static_cast<double>(potential)};
  }

  // ---- motion

  /// Returns independent rows, from which all others follow, at a pose that satisfies the joints.
  /// They must not change within a step, where poses do not satisfy the joints and dependent rows
  /// contradict.
  std::vector<Eigen::Index> independent_rows(const std::vector<Pose>& poses, Real t) const {
    return DenseFactors(matrix(poses, make_rows(poses, t, readings_))).kept();
  }

  /// Returns accelerations in `v` and `w`.
  std::vector<Pose> accelerations(const std::vector<Pose>& poses, Real t,
                                  const std::vector<Eigen::Index>& kept) const {
    const std::vector<Row> all = make_rows(poses, t, readings_);
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
    respond(poses, rows, DenseFactors(matrix(poses, rows)).solve(b), &a);
    return a;
  }

  /// Projects positions and velocities onto the joints, by the least change in the metric of the
  /// masses. Returns the largest remaining error of all joints [m].
  Real project(Real t, std::vector<Pose>* poses) const { return project(t, poses, readings_); }
  Real project(Real t, std::vector<Pose>* poses, const Readings& before) const {
    for (int k = 0; k < 4; ++k) {
      const std::vector<Row> rows = make_rows(*poses, t, before);
      if (rows.empty()) return 0;
      VectorX b(static_cast<Eigen::Index>(rows.size()));
      for (std::size_t r = 0; r < rows.size(); ++r) b[static_cast<Eigen::Index>(r)] = -rows[r].C;
      std::vector<Pose> change = *poses;
      for (Pose& pose : change) pose.v = pose.w = Vector3(0, 0, 0);
      const DenseFactors factors(matrix(*poses, rows));
      respond(*poses, rows, factors.solve(b), &change);
      Real largest = 0;
      for (std::size_t i = 0; i < poses->size(); ++i) {
        (*poses)[i].x += change[i].v;
        turn(change[i].w, &(*poses)[i].q);
        largest = std::max({largest, change[i].v.norm(), change[i].w.norm()});
      }
      if (largest < 1e-17L) break;
    }
    const std::vector<Row> rows = make_rows(*poses, t, before);
    VectorX b(static_cast<Eigen::Index>(rows.size()));
    for (std::size_t r = 0; r < rows.size(); ++r)
      b[static_cast<Eigen::Index>(r)] = rows[r].target - rows[r].times(*poses);
    respond(*poses, rows, DenseFactors(matrix(*poses, rows)).solve(b), poses);
    return error_left(*poses, t, before, rows);
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
  Vector3 gravity() const { return scene_.options.gravity.cast<Real>(); }

  Vector3 inverse_inertia_times(std::size_t i, const Quaternion& q, const Vector3& torque) const {
    Vector3 t = q.conjugate() * torque;
    for (int k = 0; k < 3; ++k) t[k] = inertia_[i][k] > 0 ? t[k] / inertia_[i][k] : 0;
    return q * t;
  }

  Row read(const Term& term, const std::vector<Pose>& poses, Real before) const {
    const Joint& joint = scene_.joints[term.joint];
    Row row = coordinate(joint.kind, Placed(joint, poses, origin_), term.which);
    const Real turn = 2 * std::acos(Real{-1});
    if (is_angle(joint, term.which)) row.C += turn * std::round((before - row.C) / turn);
    return row;
  }
  /// Returns Σ ratio q less its constant.
  Row coupled(std::size_t j, const std::vector<Pose>& poses, const Readings& before) const {
    Row row;
    const std::array<Term, 2> terms = terms_of(scene_.joints, j);
    for (std::size_t k = 0; k < 2; ++k)
      row.add(terms[k].ratio, read(terms[k], poses, before[j][k]));
    row.C -= constant_[j];
    return row;
  }

  double radius_of_ends(const Placed& p) const {
    double largest = 0.0;
    for (const int i : {p.a, p.b})
      if (i >= 0 && is_movable(static_cast<std::size_t>(i)))
        largest = std::max(largest, radius(static_cast<std::size_t>(i)));
    return largest;
  }

  std::vector<Row> make_rows(const std::vector<Pose>& poses, Real t, const Readings& before) const {
    std::vector<Row> rows;
    for (std::size_t j = 0; j < scene_.joints.size(); ++j) {
      const Joint& joint = scene_.joints[j];
      if (is_spring(joint) || is_limit(joint)) continue;
      const Placed p(joint, poses, origin_);
      add_rows(joint.kind, p, &rows);
      if (info(joint.kind).couples) rows.push_back(coupled(j, poses, before));
      if (joint.kind != JointKind::kDistance) continue;
      const Travel s = travel(joint.motor, t);
      const Real length = static_cast<Real>(*joint.distance.length) + s.s;
      Row row = p.along(p.d.value);
      row.C = (p.d.value.squaredNorm() - length * length) / 2;
      row.target = length * s.rate;
      row.gamma = p.d.rate.squaredNorm() + p.d.value.dot(p.d.gamma) - s.rate * s.rate -
                  length * s.acceleration;
      rows.push_back(row);
    }
    return rows;
  }

  // Returns the lower triangle of A.
  MatrixX matrix(const std::vector<Pose>& poses, const std::vector<Row>& rows) const {
    const auto n = static_cast<Eigen::Index>(rows.size());
    MatrixX A = MatrixX::Zero(n, n);
    std::vector<std::vector<std::pair<Eigen::Index, const Row::Block*>>> rows_of(poses.size());
    for (Eigen::Index r = 0; r < n; ++r) {
      for (const Row::Block& block : rows[static_cast<std::size_t>(r)]) {
        const auto i = static_cast<std::size_t>(block.body);
        if (!is_movable(i)) continue;
        rows_of[i].emplace_back(r, &block);
        const Vector3 v = inverse_mass_[i] * block.v;
        const Vector3 w = inverse_inertia_times(i, poses[i].q, block.w);
        for (const auto& [k, other] : rows_of[i]) A(r, k) += v.dot(other->v) + w.dot(other->w);
      }
    }
    return A;
  }

  // Adds M⁻¹ Gᵀ λ.
  void respond(const std::vector<Pose>& poses, const std::vector<Row>& rows, const VectorX& lambda,
               std::vector<Pose>* twists) const {
    for (std::size_t r = 0; r < rows.size(); ++r) {
      const Real l = lambda[static_cast<Eigen::Index>(r)];
      for (const Row::Block& block : rows[r])
        add_force(block.body, poses, l * block.v, l * block.w, twists);
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
      const Placed p(joint, poses, origin_);
      const Vector3 n = p.d.value.normalized();
      const Real stretch = p.d.value.norm() - static_cast<Real>(*spring.length);
      const Row row = p.along(n);
      const Real force = -static_cast<Real>(spring.stiffness) * stretch -
                         static_cast<Real>(spring.damping) * row.times(poses);
      for (const Row::Block& block : row)
        add_force(block.body, poses, force * block.v, force * block.w, a);
    }
  }

  // Returns the largest error of positions, and of velocities over one second [m].
  Real error_left(const std::vector<Pose>& poses, Real t, const Readings& before,
                  const std::vector<Row>& rows) const {
    Real largest = 0;
    for (std::size_t j = 0; j < scene_.joints.size(); ++j)
      if (!is_spring(scene_.joints[j]) && !is_limit(scene_.joints[j]))
        largest = std::max(largest, joint_error(j, poses, t, before));
    for (const Row& row : rows) {
      Real size = 0;
      for (const Row::Block& block : row) size = std::max(size, block.v.norm());
      if (size > 0) largest = std::max(largest, std::abs(row.times(poses) - row.target) / size);
    }
    return largest;
  }

  Scene scene_;
  Vector3 origin_ = Vector3(0, 0, 0);
  std::vector<Pose> start_;
  std::vector<Vector3> inertia_;
  std::vector<Real> inverse_mass_;
  std::vector<Real> constant_;  // right-hand sides of couplings
  Readings readings_;           // at the start
};

/// Returns the largest difference of positions, and of rotations times the radius of gyration [m].
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

}  // namespace constraint_sim::engine::reference
