#include "engine/dynamics/kernels/chain_of_bodies.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "engine/math/list.h"
#include "engine/math/quaternion_state.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

// Acceleration of one point of a body per force at another: 1/m − [to] I⁻¹ [from].
Lanes33 response(Lanes inverse_mass, const Lanes33& turned, const Lanes3& to) {
  Lanes33 K = turned.colwise().cross(to);
  K.diagonal().array() += inverse_mass;
  return K;
}

// Computes I⁻¹ [from].
Lanes33 turned_by(const Lanes33& inverse_inertia, const Lanes3& from) {
  return inverse_inertia.rowwise().cross(from.transpose());
}

// Loads three numbers per lane.
Lanes3 gather(const std::array<const double*, 2>& from) {
  const auto [a, b] = from;
  return {Lanes(a[0], b[0]), Lanes(a[1], b[1]), Lanes(a[2], b[2])};
}

// Rotation matrix of a quaternion of any length; within stages the length is off by the order of
// the method.
Lanes33 rotation_matrix(const Eigen::Quaternion<Lanes>& q) {
  const Lanes share = Lanes(1.0) / q.squaredNorm();
  Lanes33 R = (q.toRotationMatrix() - Lanes33::Identity()) * share;
  for (int k = 0; k < 3; ++k) R(k, k) += Lanes(1.0);
  return R;
}

// Inverse inertia in world axes.
Lanes33 inverse_inertia_of(const ChainPair& pair, const Lanes33& R) {
  return R * pair.inverse_inertia.asDiagonal() * R.transpose();
}

// Computes ½ (0, ω) ⊗ q as (x, y, z, w).
Eigen::Matrix<Lanes, 4, 1> quaternion_rate(const Lanes3& w, const Eigen::Quaternion<Lanes>& q) {
  return 0.5 * (Eigen::Quaternion<Lanes>(0.0, w.x(), w.y(), w.z()) * q).coeffs();
}

}  // namespace

// ---- compilation

List<ChainPair> pairs_of_chain(const IslandModel& island) {
  const auto& links = island.links();
  const std::size_t joints = links.size();
  const std::size_t bodies = island.bodies().size();
  const std::size_t before = std::max(links.front().a, links.front().b) < bodies ? 0 : 1;
  const std::size_t middle = joints / 2;
  const auto anchor = [&](std::size_t body, std::size_t l) -> Vector3d {
    if (l >= joints) return Vector3d::Zero();  // free end
    return links[l].a == body ? links[l].anchor_a : links[l].anchor_b;
  };
  const auto leads_up = [&](std::size_t l) {  // whether A to B is the direction of the first lane
    return l < before ? links[l].b == 0 : links[l].a == l - before;
  };
  struct Side {
    double inverse_mass = 0.0;
    Vector3d inverse_inertia = Vector3d::Zero();
    Vector3d anchor_to_end = Vector3d::Zero(), anchor_to_middle = Vector3d::Zero();
  };
  const auto side = [&](std::size_t point, std::size_t to_end, std::size_t to_middle) {
    Side of_point;
    const std::size_t body = point - before;
    if (body >= bodies) return of_point;  // also for the point in front of all bodies
    of_point.inverse_mass = island.inverse_mass(body);
    of_point.inverse_inertia = island.inertia(body).cwiseInverse();
    of_point.anchor_to_end = anchor(body, to_end);
    of_point.anchor_to_middle = anchor(body, to_middle);
    return of_point;
  };
  const auto in_lanes = [](const Vector3d& a, const Vector3d& b) {
    return gather({a.data(), b.data()});
  };
  List<ChainPair> pairs(middle + 1);
  for (std::size_t e = 0; e <= middle; ++e) {
    ChainPair& pair = pairs[e];
    const Side a = side(e, e - 1, e);
    const Side b = side(joints - e, joints - e, joints - e - 1);
    pair.inverse_mass = Lanes(a.inverse_mass, b.inverse_mass);
    pair.inverse_inertia = in_lanes(a.inverse_inertia, b.inverse_inertia);
    pair.anchor_to_end = in_lanes(a.anchor_to_end, b.anchor_to_end);
    pair.anchor_to_middle = in_lanes(a.anchor_to_middle, b.anchor_to_middle);
    // Where the lanes have met, both get the joint in the middle.
    pair.joints = {e, std::max(joints - 1 - e, middle)};
    pair.sense =
        Lanes(leads_up(pair.joints[0]) ? 1.0 : -1.0, leads_up(pair.joints[1]) ? -1.0 : 1.0);
  }
  return pairs;
}

ChainOfBodies::ChainOfBodies(EquationsOfMotion& equations)
    : EquationsKernel(equations),
      view_(equations.kernel_view()),
      pairs_(view_.pairs),
      joints_(equations.links().size()),
      middle_(joints_ / 2),
      position_(view_.position),
      velocity_(view_.velocity),
      free_(view_.applied_acceleration) {
  const auto& front = equations.links().front();
  const auto& back = equations.links().back();
  const std::size_t bodies = equations.bodies().size();
  first_ = std::max(front.a, front.b);
  last_ = std::max(back.a, back.b);
  before_ = first_ < bodies ? 0 : 1;
  behind_ = joints_ + 1 - before_ - bodies;
}

// ---- access to both lanes

template <class Number>
ChainOfBodies::Addresses<Number> ChainOfBodies::locate(std::size_t e, Number* of_bodies,
                                                       std::size_t stride, Number* of_first,
                                                       Number* of_last) const {
  return {e < before_ ? of_first : of_bodies + stride * (e - before_),
          e < behind_ ? of_last : of_bodies + stride * (joints_ - e - before_)};
}

inline Lanes3 ChainOfBodies::read(std::size_t e, const double* of_bodies,
                                  const Vector3d* of_points) const {
  return gather(locate(e, of_bodies, 3, of_points[first_].data(), of_points[last_].data()));
}

inline Lanes3 ChainOfBodies::read_turning(std::size_t e, const double* of_bodies) const {
  static constexpr std::array<double, 3> kFixed = {0.0, 0.0, 0.0};
  return gather(locate(e, of_bodies, 3, kFixed.data(), kFixed.data()));
}

inline ChainOfBodies::Quaternions ChainOfBodies::read_rotation(std::size_t e,
                                                               const double* y) const {
  static constexpr std::array<double, 4> kUnrotated = {0.0, 0.0, 0.0, 1.0};
  const auto [a, b] = locate(e, y + view_.q_at, 4, kUnrotated.data(), kUnrotated.data());
  return {Lanes(a[3], b[3]), Lanes(a[0], b[0]), Lanes(a[1], b[1]), Lanes(a[2], b[2])};
}

// Writes the first lane last: where both lanes meet at one body, only the first lane knows both
// joints of the body.
template <class Vector>
void ChainOfBodies::write(std::size_t e, const Vector& value, double* of_bodies) const {
  constexpr auto kSize = static_cast<std::size_t>(Vector::SizeAtCompileTime);
  const auto [a, b] = locate<double>(e, of_bodies, kSize, nullptr, nullptr);
  if (b != nullptr)
    for (std::size_t k = 0; k < kSize; ++k) b[k] = value[static_cast<Eigen::Index>(k)].second();
  if (a != nullptr)
    for (std::size_t k = 0; k < kSize; ++k) a[k] = value[static_cast<Eigen::Index>(k)].first();
}

inline void ChainOfBodies::write_forces(double* by_unknown) const {
  for (std::size_t e = 0; e <= middle_; ++e) {
    const ChainPair& pair = pairs_[e];
    const Lanes3 force = pair.sense * pair.solution;
    const std::size_t* const a = view_.unknown + 3 * pair.joints[0];
    const std::size_t* const b = view_.unknown + 3 * pair.joints[1];
    for (std::size_t k = 0; k < 3; ++k) {
      by_unknown[a[k]] = force[static_cast<Eigen::Index>(k)].first();
      by_unknown[b[k]] = force[static_cast<Eigen::Index>(k)].second();
    }
  }
}

// ---- System

void ChainOfBodies::derivative(std::size_t stage, double t, const double* y, double* dydt) {
  if (equations_.inputs().is_time_dependent()) equations_.move_with_time(t);
  if (!depends_ && accelerate(stage, y, dydt)) return;
  depends_ = true;
  equations_.derivative(stage, t, y, dydt);
}

// Flattened, since function calls would take a third of the time.
[[gnu::flatten]] bool ChainOfBodies::accelerate(std::size_t stage, const double* y, double* dydt) {
  const double* const v = y + view_.v_at;
  const double* const L = y + view_.L_at;
  double* const v_dot = dydt + view_.v_at;
  double* const L_dot = dydt + view_.L_at;
  const double* const torques = view_.applied_torque->data();
  const auto find_motion = [&](std::size_t e, const Quaternions& q, const Lanes33& I_inverse) {
    const Lanes3 momentum = read_turning(e, L);
    const Lanes3 w = I_inverse * momentum;
    const Lanes3 spun = I_inverse * (read_turning(e, torques) + momentum.cross(w));
    write(e, quaternion_rate(w, q), dydt + view_.q_at);
    const Lanes3 free = read(e, free_->data(), free_);
    return
        [=](const Lanes3& arm) -> Lanes3 { return free + spun.cross(arm) + w.cross(w.cross(arm)); };
  };
  if (!factor(y, find_motion)) return false;
  substitute([&](std::size_t e, const Lanes3& force, const Lanes3& torque) {
    write(e, read(e, v, velocity_), dydt);
    write(e, Lanes3(read(e, free_->data(), free_) + pairs_[e].inverse_mass * force), v_dot);
    write(e, Lanes3(read_turning(e, torques) + torque), L_dot);
  });
  write_forces(view_.stage_forces + stage * view_.unknowns);
  return true;
}

bool ChainOfBodies::project(double t, double* y) {
  if (depends_) return equations_.project(t, y);
  return equations_.project_by(
      t, y, [&] { return find_values(y); },
      [&] {
        reduce();
        add_response(y);
      });
}

bool ChainOfBodies::restart(double* y, double* dydt) {
  double* const v = y + view_.v_at;
  double* const L = y + view_.L_at;
  const auto find_motion = [&](std::size_t e, const Quaternions&, const Lanes33& I_inverse) {
    const Lanes3 w = I_inverse * read_turning(e, L);
    const Lanes3 velocity = read(e, v, velocity_);
    return [=](const Lanes3& arm) -> Lanes3 { return velocity + w.cross(arm); };
  };
  depends_ = !factor(y, find_motion);
  if (depends_) return equations_.restart(y, dydt);
  substitute([&](std::size_t e, const Lanes3& force, const Lanes3& torque) {
    write(e, Lanes3(read(e, v, velocity_) + pairs_[e].inverse_mass * force), v);
    write(e, Lanes3(read_turning(e, L) + torque), L);
  });
  double* const solution = view_.solution;
  write_forces(solution);
  for (std::size_t i = 0; i < equations_.rows(); ++i) view_.impulses[i] += solution[i];
  return accelerate(0, y, dydt);
}

// ---- positions

// Sets solution to −C, and the arms. Returns the largest error of a joint [m].
double ChainOfBodies::find_values(double* y) {
  if (!normalize_quaternions(y + view_.q_at, equations_.bodies().size()))
    return std::numeric_limits<double>::quiet_NaN();
  double worst = 0.0;
  const auto set_value = [&](std::size_t e, const Lanes3& d) {
    ChainPair& pair = pairs_[e];
    pair.solution = -d;
    for (Eigen::Index k = 0; k < 3; ++k) {
      for (const double value : {pair.solution[k].first(), pair.solution[k].second()}) {
        const double error = std::abs(value);
        if (!(error <= worst)) worst = error;  // keeps a NaN
      }
    }
  };
  Lanes3 outer = Lanes3::Constant(0.0);
  for (std::size_t e = 0; e <= middle_; ++e) {
    ChainPair& pair = pairs_[e];
    const Lanes33 R = read_rotation(e, y).toRotationMatrix();
    const Lanes3 x = read(e, y, position_);
    pair.arm_to_end = R * pair.anchor_to_end;
    pair.arm_to_middle = R * pair.anchor_to_middle;
    const Lanes3 inner = x + pair.arm_to_middle;
    if (e > 0) set_value(e - 1, x + pair.arm_to_end - outer);
    outer = is_idle(e) ? join(inner, outer) : inner;
  }
  set_value(middle_, swapped(outer) - outer);
  return worst;
}

// Adds M⁻¹ Gᵀ of the forces that reduce() has prepared to positions and orientations.
void ChainOfBodies::add_response(double* y) {
  substitute([&](std::size_t e, const Lanes3& force, const Lanes3& torque) {
    const Quaternions q = read_rotation(e, y);
    const Lanes33 R = q.toRotationMatrix();
    const Lanes3 turn = R * pairs_[e].inverse_inertia.cwiseProduct(Lanes3(R.transpose() * torque));
    write(e, Lanes3(read(e, y, position_) + pairs_[e].inverse_mass * force), y);
    const Eigen::Matrix<Lanes, 4, 1> turned = q.coeffs() + quaternion_rate(turn, q);
    write(e, turned, y + view_.q_at);
  });
}

// ---- the linear system

// Factors the chain's matrix A = G M⁻¹ Gᵀ, and reduces the right-hand side: the relative motion at
// each joint.
template <class FindMotion>
bool ChainOfBodies::factor(const double* y, const FindMotion& find_motion) {
  // Contribution of the body on the outer side of a joint, with everything eliminated on that side.
  struct Side {
    Lanes33 K = Lanes33::Constant(0.0);
    Lanes3 entries = Lanes3::Constant(0.0);  // entries of A
    Lanes3 motion = Lanes3::Constant(0.0);
  };
  Side outer;
  auto is_regular = Lanes(1.0) > Lanes(0.0);
  for (std::size_t e = 0; e <= middle_; ++e) {
    ChainPair& pair = pairs_[e];
    const Quaternions q = read_rotation(e, y);
    const Lanes33 R = rotation_matrix(q);
    const Lanes33 I_inverse = inverse_inertia_of(pair, R);
    const auto motion = find_motion(e, q, I_inverse);
    const Lanes3 to_middle = pair.arm_to_middle = R * pair.anchor_to_middle;
    Side inner;
    inner.K = response(pair.inverse_mass, turned_by(I_inverse, to_middle), to_middle);
    inner.entries = inner.K.diagonal();
    inner.motion = motion(to_middle);
    if (e > 0) {
      const Lanes3 to_end = pair.arm_to_end = R * pair.anchor_to_end;
      const Lanes33 turned = turned_by(I_inverse, to_end);
      const Lanes33 K = response(pair.inverse_mass, turned, to_end);
      BlockPivot& pivot = pairs_[e - 1].pivot;
      is_regular &=
          pivot.factor(outer.K + K, DelassusMatrix::kLeastPivot, outer.entries + K.diagonal());
      inner.K -= pivot.couple(-response(pair.inverse_mass, turned, to_middle));
      inner.motion -= pivot.reduce(outer.motion - motion(to_end));
    }
    if (is_idle(e)) {
      inner.K = join(inner.K, outer.K);
      inner.entries = join(inner.entries, outer.entries);
      inner.motion = join(inner.motion, outer.motion);
    }
    outer = inner;
  }
  BlockPivot& pivot = pairs_[middle_].pivot;
  is_regular &= pivot.factor(outer.K + swapped(outer.K), DelassusMatrix::kLeastPivot,
                             outer.entries + swapped(outer.entries));
  pivot.reduce(outer.motion - swapped(outer.motion));
  return is_regular[0] != 0 && is_regular[1] != 0;
}

// Reduces the right-hand side of find_values() with the existing factors.
void ChainOfBodies::reduce() {
  Lanes3 taken = Lanes3::Constant(0.0);
  for (std::size_t e = 1; e <= middle_; ++e) {
    const Lanes3 inner = pairs_[e - 1].pivot.reduce(pairs_[e - 1].solution - taken);
    taken = is_idle(e) ? join(inner, taken) : inner;
  }
  pairs_[middle_].pivot.reduce(pairs_[middle_].solution - taken + swapped(taken));
}

// Substitutes from the middle, where both lanes hold the same joint, seen from either side. Calls
// `act` with force and torque on the bodies of each pair.
template <class Act>
void ChainOfBodies::substitute(const Act& act) {
  Lanes3 inner = pairs_[middle_].solution = pairs_[middle_].pivot.substitute(Lanes3::Constant(0.0));
  for (std::size_t e = middle_; e > 0; --e) {
    const ChainPair& pair = pairs_[e];
    Lanes3 outer = pairs_[e - 1].pivot.substitute(inner);
    if (is_idle(e)) outer = join(outer, inner);
    pairs_[e - 1].solution = outer;
    act(e, outer - inner, pair.arm_to_end.cross(outer) - pair.arm_to_middle.cross(inner));
    inner = outer;
  }
  act(0, -inner, -pairs_[0].arm_to_middle.cross(inner));
}

}  // namespace constraint_sim::engine
