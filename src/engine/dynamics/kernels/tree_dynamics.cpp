#include "engine/dynamics/kernels/tree_dynamics.h"

#include <algorithm>
#include <cmath>

#include "engine/math/elementary.h"
#include "engine/math/larger.h"
#include "engine/math/quaternion_state.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

/// Rate of a spatial motion that moves with `motion`.
SpatialVector cross(const SpatialVector& motion, const SpatialVector& of) {
  return {motion.angular.cross(of.linear) + motion.linear.cross(of.angular),
          motion.angular.cross(of.angular)};
}

/// Turns a frame by an angle about its own axis.
void turn(Matrix3d* axes, std::uint8_t axis, double angle) {
  const auto [sine, cosine] = math::sin_cos(angle);
  const int first = (axis + 1) % 3, second = (axis + 2) % 3;
  const Vector3d a = axes->col(first), b = axes->col(second);
  axes->col(first) = cosine * a + sine * b;
  axes->col(second) = cosine * b - sine * a;
}

template <class Number>
using Vector3 = Eigen::Matrix<Number, 3, 1>;
template <class Number>
using Matrix3 = Eigen::Matrix<Number, 3, 3>;

/// Returns the inertia of a body about its centre, in world axes.
template <class Number>
SymmetricMatrix<Number> turned_inertia(const Matrix3<Number>& axes,
                                       const Matrix3<Number>& inertia) {
  const Matrix3<Number> half = axes * inertia;
  const auto entry = [&](int i, int j) {
    return half(i, 0) * axes(j, 0) + half(i, 1) * axes(j, 1) + half(i, 2) * axes(j, 2);
  };
  return {{entry(0, 0), entry(1, 1), entry(2, 2)}, {entry(1, 2), entry(0, 2), entry(0, 1)}};
}

/// Returns the inertia about the origin of a body with inertia `own` about its centre.
template <class Number>
SymmetricMatrix<Number> at_origin(const Vector3<Number>& moment, const Vector3<Number>& centre,
                                  const SymmetricMatrix<Number>& own) {
  const Vector3<Number> squares = moment.cwiseProduct(centre);
  return {own.diagonal + Vector3<Number>(squares.y() + squares.z(), squares.x() + squares.z(),
                                         squares.x() + squares.y()),
          own.beside - Vector3<Number>(moment.y() * centre.z(), moment.x() * centre.z(),
                                       moment.x() * centre.y())};
}

/// Returns lanes of two bodies.
template <int kRows, int kColumns>
Eigen::Matrix<Lanes, kRows, kColumns> both(const Eigen::Matrix<double, kRows, kColumns>& a,
                                           const Eigen::Matrix<double, kRows, kColumns>& b) {
  Eigen::Matrix<Lanes, kRows, kColumns> lanes;
  for (int i = 0; i < kRows * kColumns; ++i) lanes.data()[i] = Lanes(a.data()[i], b.data()[i]);
  return lanes;
}
Vector3d of_first(const Lanes3& lanes) {
  return {lanes.x().first(), lanes.y().first(), lanes.z().first()};
}
Vector3d of_second(const Lanes3& lanes) {
  return {lanes.x().second(), lanes.y().second(), lanes.z().second()};
}

}  // namespace

TreeDynamics::TreeDynamics(const JointTree& tree) {
  const std::size_t bodies = tree.bodies.size(), motions = tree.motions.size();
  placed_.resize(bodies);
  for (std::size_t i = 0; i < bodies; i += 2)
    inertia_.push_back(
        both(tree.bodies[i].inertia, tree.bodies[std::min(i + 1, bodies - 1)].inertia));
  composite_.resize(bodies);
  for (auto* list : {&transmitted_, &added_, &subtree_}) list->resize(bodies);
  for (auto* list : {&direction_, &moved_}) list->resize(motions);
  for (auto* list : {&force_, &acceleration_, &unknown_acceleration_, &b_, &diagonal_})
    list->assign(motions, 0.0);
  H_.assign(motions * motions, 0.0);
  if (tree.couplings.empty()) return;
  const std::size_t independent = tree.independent.size();
  reduced_.assign(independent * independent, 0.0);
  reduced_b_.assign(independent, 0.0);
  place_of_.assign(motions, 0);
  for (std::size_t i = 0; i < independent; ++i) place_of_[tree.independent[i]] = i;
  for (std::size_t k = 0; k < motions; ++k)
    if (tree.motions[k].source != kNoIndex) place_of_[k] = place_of_[tree.motions[k].source];
}

// ---- from the root to the leaves

[[gnu::flatten]] void TreeDynamics::place(const JointTree& tree, const List<TreeRoot>& roots,
                                          const double* y) {
  for (std::size_t i = 0; i < tree.bodies.size(); ++i) {
    const TreeBody& body = tree.bodies[i];
    const TreeRoot& root = roots[i];
    Placed& at = placed_[i];
    if (body.parent != kNoIndex) {
      const Placed& parent = placed_[body.parent];
      at.axes.noalias() = parent.axes * body.axes_of_parent;
      at.point = parent.point + parent.axes * body.place_in_parent;
      at.motion = parent.motion;
      at.bias = parent.bias;
    } else {
      at.axes.noalias() = root.axes * body.axes_of_parent;
      at.point.setZero();
      at.motion = {root.velocity, root.angular_velocity};
      at.bias.linear = root.acceleration - root.angular_velocity.cross(root.velocity);
      at.bias.angular.setZero();
    }
    place_node(body, tree.motions.data(), y, y + tree.rate_at, &at);
    at.centre = at.point + at.axes * body.centre;
  }
}

void TreeDynamics::place_node(const TreeBody& body, const TreeMotion* motions, const double* y,
                              const double* rates, Placed* at) {
  at->axes_before = at->axes;
  at->point_before = at->point;
  const auto add = [&](const SpatialVector& rate) {
    at->bias = at->bias + cross(at->motion, rate);
    at->motion = at->motion + rate;
  };
  const bool is_free = body.link == kNoIndex;
  const std::size_t end = body.turns_freely ? body.end - 3 : body.end;
  for (std::size_t k = body.first; k < end; ++k) {
    const TreeMotion& motion = motions[k];
    const Vector3d axis = at->axes.col(motion.axis);
    SpatialVector& direction = direction_[k];
    direction = motion.turns ? SpatialVector{at->point.cross(axis), axis}
                             : SpatialVector{axis, Vector3d::Zero()};
    add(direction * rates[k]);
    if (motion.is_prescribed) at->bias = at->bias + direction * acceleration_[k];
    if (motion.turns)
      turn(&at->axes, motion.axis, y[motion.position]);
    else if (!is_free)  // the origin moves with a free root
      at->point += y[motion.position] * axis;
  }
  if (!body.turns_freely) return;
  const Matrix3d turned = rotation_matrix(y + body.quaternion);
  at->axes *= turned;
  for (std::size_t k = 0; k < 3; ++k) {
    const Vector3d axis = at->axes.col(static_cast<Eigen::Index>(k));
    direction_[end + k] = {at->point.cross(axis), axis};
  }
  const Vector3d spin = at->axes * Vector3d::Map(rates + end);
  add({at->point.cross(spin), spin});
}

// ---- from the leaves to the root

// Evaluates the inertias of two bodies, and the forces that move them with zero ẍ of unknown
// motions. A last single body is in both lanes.
void TreeDynamics::find_own(const JointTree& tree, std::size_t i, const Vector3d* acceleration,
                            const Vector3d* torque) {
  const std::size_t j = std::min(i + 1, tree.bodies.size() - 1);
  const TreeBody &body = tree.bodies[i], &other = tree.bodies[j];
  const Placed &at = placed_[i], &beside = placed_[j];
  const Lanes mass(body.mass, other.mass);
  const Lanes3 centre = both(at.centre, beside.centre);
  const Lanes3 w = both(at.motion.angular, beside.motion.angular);
  const Lanes3 alpha = both(at.bias.angular, beside.bias.angular);
  const SymmetricMatrix<Lanes> I =
      turned_inertia<Lanes>(both(at.axes, beside.axes), inertia_[i / 2]);
  const Lanes3 moment = mass * centre;
  const SymmetricMatrix<Lanes> whole = at_origin<Lanes>(moment, centre, I);
  const Lanes3 v = both(at.motion.linear, beside.motion.linear) + w.cross(centre);
  const Lanes3 a = both(at.bias.linear, beside.bias.linear) + alpha.cross(centre) + w.cross(v);
  const Lanes3 force = mass * (a - both(acceleration[body.body], acceleration[other.body]));
  const Lanes3 turning = I * alpha + w.cross(I * w) - both(torque[body.body], torque[other.body]) +
                         centre.cross(force);
  composite_[i] = {body.mass, of_first(moment), {of_first(whole.diagonal), of_first(whole.beside)}};
  transmitted_[i] = {of_first(force), of_first(turning)};
  if (i == j) return;
  composite_[j] = {
      other.mass, of_second(moment), {of_second(whole.diagonal), of_second(whole.beside)}};
  transmitted_[j] = {of_second(force), of_second(turning)};
}

[[gnu::flatten]] void TreeDynamics::evaluate(const JointTree& tree, const Vector3d* acceleration,
                                             const Vector3d* torque) {
  for (std::size_t i = 0; i < tree.bodies.size(); i += 2) find_own(tree, i, acceleration, torque);
  for (std::size_t i = tree.bodies.size(); i-- > 0;) {
    const TreeBody& body = tree.bodies[i];
    for (std::size_t k = body.end; k-- > body.first;) {
      const TreeMotion& motion = tree.motions[k];
      if (motion.is_prescribed) continue;
      moved_[k] = composite_[i] * direction_[k];
      b_[k] = force_[k] - direction_[k].dot(transmitted_[i]);
      double* const entries = row(k);
      for (std::size_t j = k; j != kNoIndex; j = tree.motions[j].before)
        entries[tree.motions[j].depth] = direction_[j].dot(moved_[k]);
    }
    if (body.parent == kNoIndex) continue;
    composite_[body.parent] += composite_[i];
    transmitted_[body.parent] = transmitted_[body.parent] + transmitted_[i];
  }
}

// H = Lᵀ D L along branches. Row k and the row of any motion before motion k have their first
// entries for common motions. Forces are eliminated on the way.
[[gnu::flatten]] void TreeDynamics::factor(const JointTree& tree, double* forces) {
  const auto before = [&](std::size_t k) { return tree.motions[k].before; };
  for (const std::size_t k : tree.independent) diagonal_[k] = row(k)[tree.motions[k].depth];
  for (std::size_t k = tree.motions.size(); k-- > 0;) {
    if (tree.motions[k].is_prescribed) continue;
    double* const entries = row(k);
    std::size_t depth = tree.motions[k].depth;
    const double inverse = 1.0 / entries[depth];
    for (std::size_t i = before(k); i != kNoIndex; i = before(i)) {
      const double l = entries[--depth] * inverse;
      double* const above = row(i);
      for (std::size_t d = 0; d <= depth; ++d) above[d] -= l * entries[d];
      forces[i] -= l * forces[k];
      entries[depth] = l;
    }
    forces[k] *= inverse;
  }
}

// Replaces eliminated forces on motions by accelerations.
void TreeDynamics::substitute(const JointTree& tree, double* numbers) const {
  for (std::size_t k = 0; k < tree.motions.size(); ++k) {
    if (tree.motions[k].is_prescribed) continue;
    const double* const entries = row(k);
    double sum = numbers[k];
    for (std::size_t i = tree.motions[k].before; i != kNoIndex; i = tree.motions[i].before)
      sum -= entries[tree.motions[i].depth] * numbers[i];
    numbers[k] = sum;
  }
}

void TreeDynamics::apply_inverse(const JointTree& tree, double* numbers) const {
  if (!tree.couplings.empty()) return apply_coupled_inverse(tree, numbers, numbers);
  for (std::size_t k = tree.motions.size(); k-- > 0;) {
    if (tree.motions[k].is_prescribed) continue;
    const double* const entries = row(k);
    for (std::size_t i = tree.motions[k].before; i != kNoIndex; i = tree.motions[i].before)
      numbers[i] -= entries[tree.motions[i].depth] * numbers[k];
    numbers[k] /= entries[tree.motions[k].depth];
  }
  substitute(tree, numbers);
}

void TreeDynamics::solve(const JointTree& tree) {
  double* const accelerations = unknown_acceleration_.data();
  if (tree.couplings.empty()) {
    std::copy(b_.begin(), b_.end(), accelerations);
    factor(tree, accelerations);
    substitute(tree, accelerations);
  } else {
    factor_coupled(tree);
    apply_coupled_inverse(tree, b_.data(), accelerations);
  }
  for (std::size_t k = 0; k < tree.motions.size(); ++k)
    if (!tree.motions[k].is_prescribed) acceleration_[k] = accelerations[k];
}

// Factors the matrix of the independent motions, Gᵀ H G, where G has the factors of couplings.
void TreeDynamics::factor_coupled(const JointTree& tree) {
  const std::size_t n = reduced_b_.size();
  const auto R = [&](std::size_t i, std::size_t j) -> double& { return reduced_[i * n + j]; };
  std::fill(reduced_.begin(), reduced_.end(), 0.0);
  for (std::size_t k = 0; k < tree.motions.size(); ++k) {
    if (tree.motions[k].is_prescribed) continue;
    const std::size_t place = place_of_[k];
    for (std::size_t j = k; j != kNoIndex; j = tree.motions[j].before) {
      const double entry =
          tree.motions[k].factor * tree.motions[j].factor * row(k)[tree.motions[j].depth];
      R(place, place_of_[j]) += entry;
      if (j != k) R(place_of_[j], place) += entry;
    }
  }
  for (std::size_t i = 0; i < n; ++i) diagonal_[tree.independent[i]] = R(i, i);
  for (std::size_t i = n; i-- > 0;) {
    for (std::size_t j = i; j-- > 0;) {
      const double l = R(i, j) / R(i, i);
      for (std::size_t k = 0; k <= j; ++k) R(j, k) -= l * R(i, k);
      R(i, j) = l;
    }
    const std::size_t k = tree.independent[i];
    row(k)[tree.motions[k].depth] = R(i, i);
  }
}

void TreeDynamics::apply_coupled_inverse(const JointTree& tree, const double* forces,
                                         double* numbers) const {
  const std::size_t n = reduced_b_.size();
  const auto R = [&](std::size_t i, std::size_t j) { return reduced_[i * n + j]; };
  for (double& sum : reduced_b_) sum = 0.0;
  for (std::size_t k = 0; k < tree.motions.size(); ++k)
    if (!tree.motions[k].is_prescribed)
      reduced_b_[place_of_[k]] += tree.motions[k].factor * forces[k];
  for (std::size_t i = n; i-- > 0;) {
    for (std::size_t j = i; j-- > 0;) reduced_b_[j] -= R(i, j) * reduced_b_[i];
    reduced_b_[i] /= R(i, i);
  }
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = 0; j < i; ++j) reduced_b_[i] -= R(i, j) * reduced_b_[j];
  for (std::size_t k = 0; k < tree.motions.size(); ++k)
    if (!tree.motions[k].is_prescribed)
      numbers[k] = tree.motions[k].factor * reduced_b_[place_of_[k]];
}

void TreeDynamics::add_wrench(const JointTree& tree, std::size_t body,
                              const SpatialVector& wrench) {
  for (std::size_t i = body; i != kNoIndex; i = tree.bodies[i].parent) {
    transmitted_[i] = transmitted_[i] - wrench;
    for (std::size_t k = tree.bodies[i].first; k < tree.bodies[i].end; ++k)
      if (!tree.motions[k].is_prescribed) b_[k] += direction_[k].dot(wrench);
  }
}

void TreeDynamics::add_to_accelerations(const double* change) {
  for (std::size_t k = 0; k < acceleration_.size(); ++k) {
    acceleration_[k] += change[k];
    unknown_acceleration_[k] += change[k];
  }
}

double TreeDynamics::least_pivot(const JointTree& tree) const {
  double least = 1.0;
  for (const std::size_t k : tree.independent) {
    const double share = H_[k * direction_.size() + tree.motions[k].depth] / diagonal_[k];
    if (!(share >= least)) least = share;  // also where it is not a number
  }
  return least;
}

void TreeDynamics::add_along_branches(const JointTree& tree, const double* rates) const {
  for (std::size_t i = 0; i < tree.bodies.size(); ++i) {
    const TreeBody& body = tree.bodies[i];
    SpatialVector& sum = added_[i];
    sum = body.parent == kNoIndex ? SpatialVector{} : added_[body.parent];
    for (std::size_t k = body.first; k < body.end; ++k) sum = sum + direction_[k] * rates[k];
  }
}

// Finds the force that each joint transmits: the force that accelerates its subtree with the
// parent, plus a force for each motion in the subtree.
[[gnu::flatten]] void TreeDynamics::find_transmitted(const JointTree& tree) {
  add_accelerations(tree);
  for (std::size_t i = 0; i < tree.bodies.size(); ++i)
    if (const std::size_t parent = tree.bodies[i].parent; parent != kNoIndex)
      transmitted_[i] = transmitted_[i] + composite_[i] * added_[parent];
  for (SpatialVector& sum : subtree_) sum = {};
  for (std::size_t i = tree.bodies.size(); i-- > 0;) {
    const TreeBody& body = tree.bodies[i];
    for (std::size_t k = body.first; k < body.end; ++k)
      if (!tree.motions[k].is_prescribed) subtree_[i] = subtree_[i] + moved_[k] * acceleration_[k];
    transmitted_[i] = transmitted_[i] + subtree_[i];
    if (body.parent != kNoIndex) subtree_[body.parent] = subtree_[body.parent] + subtree_[i];
  }
}

// ---- results

void TreeDynamics::find_momentum(const JointTree& tree, SpatialVector* momentum,
                                 CompositeInertia* inertia) const {
  *momentum = {};
  *inertia = {};
  for (std::size_t i = 0; i < tree.bodies.size(); ++i) {
    const TreeBody& body = tree.bodies[i];
    const Placed& at = placed_[i];
    const Vector3d moment = body.mass * at.centre;
    const CompositeInertia own = {
        body.mass, moment,
        at_origin<double>(moment, at.centre, turned_inertia<double>(at.axes, body.inertia))};
    *momentum = *momentum + own * at.motion;
    *inertia += own;
  }
}

double TreeDynamics::squared_size_of(const JointTree& tree, const double* change) const {
  add_along_branches(tree, change);
  double largest = 0.0;
  for (std::size_t i = 0; i < tree.bodies.size(); ++i) {
    const SpatialVector& moved = added_[i];
    const Vector3d along = moved.linear + moved.angular.cross(placed_[i].centre);
    largest = larger(largest, along.squaredNorm());
    largest = larger(largest, tree.bodies[i].squared_gyration * moved.angular.squaredNorm());
  }
  return largest;
}

}  // namespace constraint_sim::engine
