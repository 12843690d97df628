// Dynamics of robots, for controllers.

#include "constraint_sim/engine/robot_dynamics.h"

#include <algorithm>
#include <string>

#include "engine/constraints/closing_errors.h"
#include "engine/dynamics/robots/mass_factors.h"
#include "engine/dynamics/robots/robot_tree.h"
#include "engine/dynamics/robots/tree_quantities.h"
#include "engine/dynamics/robots/tree_state.h"
#include "engine/math/cross_matrix.h"
#include "engine/math/dense.h"
#include "engine/model/validate.h"
#include "engine/world/robot_coordinates.h"
#include "engine/world/robot_members.h"
#include "engine/world/world_impl.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

// Share of a diagonal entry of M below which a pivot is rounding.
constexpr double kSingularPivot = 1e-12;

List<Vector3d> falls_of(const Model& model, const RobotTree& robot) {
  List<Vector3d> falls;
  for (const int body : robot.bodies()) falls.push_back(model.gravity_on(to_index(body)));
  return falls;
}

// Couplings add entries of both triangles in different orders.
MatrixXd symmetric(const MatrixXd& M) { return 0.5 * (M + M.transpose()); }

}  // namespace

struct RobotDynamics::Impl {
  Impl(const WorldImpl& world, const List<std::size_t>& seeds);
  Impl(const Impl&) = delete;  // `quantities` refers to `robot`
  Impl& operator=(const Impl&) = delete;

  void check_closed(const WorldImpl& world) const;
  void find_passive();
  void check_numbers(const char* field, const VectorXd& numbers) const;
  MassFactors factors() const;
  /// Rates of small rotation vectors by the rotation vectors themselves, n × n.
  MatrixXd turning() const;

  List<std::size_t> joints;  // indices in the world
  RobotTree robot;
  TreeState pose;
  TreeQuantities quantities;  // motions of the tree, without couplings
  RobotCoordinates coordinates;
  std::vector<BodyId> bodies;
  List<std::string> body_names;
  List<std::size_t> tree_body;  // body of the tree, per body
  double pose_error = 0.0;
  MatrixXd mass;
  VectorXd bias, gravity, passive;
  MatrixXd stiffness, damping;  // −∂p/∂q, −∂p/∂q̇
};

RobotDynamics::Impl::Impl(const WorldImpl& world, const List<std::size_t>& seeds)
    : joints(joints_of_robot(world, world, seeds)),
      robot([&] {
        RobotTree made(robot_joints(world, joints), world.masses, seeds.front());
        check_robot(world, joints, made);
        return made;
      }()),
      pose(robot, world.states),
      quantities(robot.tree(), pose, falls_of(world, robot)),
      coordinates({world, world, joints, robot, pose}),
      mass(symmetric(coordinates.reduced(quantities.mass()))),
      bias(coordinates.reduced(quantities.bias())),
      gravity(coordinates.reduced(quantities.weight())) {
  tree_body.resize(robot.bodies().size());
  for (std::size_t i = 0; i < robot.tree().bodies.size(); ++i) {
    tree_body[robot.tree().bodies[i].body] = i;
    pose_error = std::max(pose_error, pose.opening(i));
  }
  for (const int member : robot.bodies()) {
    bodies.push_back(world.body_ids[to_index(member)]);
    body_names.push_back(world.bodies[member].name);
  }
  check_closed(world);
  find_passive();
}

void RobotDynamics::Impl::check_closed(const WorldImpl& world) const {
  for (std::size_t i = 0; i < robot.tree().bodies.size(); ++i) {
    const TreeBody& body = robot.tree().bodies[i];
    if (body.link == kNoIndex || !(pose.opening(i) > kClosedError)) continue;
    const std::size_t j = joints[robot.joints()[body.link]];
    if (world.joint_states[j].closing)
      refuse("body", "constraint " + in_quotes(world.joints[j].name) + " is still open by " +
                         shortest(pose.opening(i)) + " m or rad; step until it is closed");
  }
}

// Springs and dampers act along motions, whose directions are those of coordinates up to the sign.
void RobotDynamics::Impl::find_passive() {
  const JointTree& tree = robot.tree();
  const auto motions = static_cast<Index>(tree.motions.size());
  VectorXd forces = VectorXd::Zero(motions);
  MatrixXd K = MatrixXd::Zero(motions, motions), C = K;
  for (std::size_t k = 0; k < tree.motions.size(); ++k) {
    const TreeMotion& motion = tree.motions[k];
    if (motion.soft == kNoIndex) continue;
    const SoftLaw& law = robot.soft_coordinates()[motion.soft].law;
    forces[k] =
        motion.sense * law.force(coordinates.position(k), motion.sense * quantities.rates()[k]);
    K(k, k) = law.K;
    C(k, k) = law.C;
  }
  passive = coordinates.reduced(forces);
  stiffness = coordinates.reduced(K);
  damping = coordinates.reduced(C);
}

void RobotDynamics::Impl::check_numbers(const char* field, const VectorXd& numbers) const {
  const auto n = static_cast<Index>(coordinates.all().size());
  if (numbers.size() != n)
    refuse(field, "must have " + std::to_string(n) + " numbers, one per coordinate, got " +
                      std::to_string(numbers.size()));
  for (Index k = 0; k < n; ++k) check_finite(field + ("[" + std::to_string(k) + "]"), numbers[k]);
}

MassFactors RobotDynamics::Impl::factors() const {
  MassFactors made(mass);
  if (!(made.least_pivot() > kSingularPivot))
    refuse("body", "the mass matrix is singular to rounding at coordinate " +
                       in_quotes(coordinates.all()[to_index(made.least_coordinate())].name));
  return made;
}

MatrixXd RobotDynamics::Impl::turning() const {
  const auto n = static_cast<Index>(coordinates.all().size());
  MatrixXd rates = MatrixXd::Zero(n, n);
  for (const TreeBody& body : robot.tree().bodies) {
    if (!body.turns_freely) continue;
    const std::size_t first = body.end - 3;
    const Eigen::Matrix3d block = -cross_matrix(quantities.rates().segment<3>(first));
    for (std::size_t i = 0; i < 3; ++i)
      for (std::size_t j = 0; j < 3; ++j)
        rates(coordinates.coordinate_of(first + i), coordinates.coordinate_of(first + j)) =
            block(i, j);
  }
  return rates;
}

RobotDynamics::RobotDynamics(const World& world, const std::vector<BodyId>& bodies) {
  const WorldImpl& impl = ImplAccess::of(world);
  impl_ = std::make_shared<const Impl>(impl, dynamic_bodies(impl, bodies));
}

RobotDynamics::RobotDynamics(const World& world, BodyId body)
    : RobotDynamics(world, std::vector<BodyId>{body}) {}

const std::vector<RobotCoordinate>& RobotDynamics::coordinates() const {
  return impl_->coordinates.all();
}
const std::vector<RobotFollower>& RobotDynamics::followers() const {
  return impl_->coordinates.followers();
}
const std::vector<BodyId>& RobotDynamics::bodies() const { return impl_->bodies; }
double RobotDynamics::pose_error() const { return impl_->pose_error; }
const MatrixXd& RobotDynamics::mass_matrix() const { return impl_->mass; }
const VectorXd& RobotDynamics::bias() const { return impl_->bias; }
const VectorXd& RobotDynamics::gravity() const { return impl_->gravity; }
const VectorXd& RobotDynamics::passive() const { return impl_->passive; }

VectorXd RobotDynamics::position() const {
  VectorXd numbers(static_cast<Index>(size()));
  for (std::size_t k = 0; k < size(); ++k) numbers[k] = coordinates()[k].position;
  return numbers;
}

VectorXd RobotDynamics::velocity() const {
  VectorXd numbers(static_cast<Index>(size()));
  for (std::size_t k = 0; k < size(); ++k) numbers[k] = coordinates()[k].velocity;
  return numbers;
}

RobotDynamics::PointMotion RobotDynamics::motion_of(BodyId body, const Vector3d& point) const {
  const auto found = std::find(bodies().begin(), bodies().end(), body);
  if (found == bodies().end())
    refuse("body", "must be a body of the robot of " + in_quotes(impl_->body_names.front()) +
                       ", got id " + std::to_string(body.value));
  check_finite("point", point);
  const std::size_t place = impl_->tree_body[found - bodies().begin()];
  const TreeQuantities::PointMotion all = impl_->quantities.motion_of(place, point);
  PointMotion motion;
  motion.velocity = all.velocity;
  motion.bias = all.bias;
  motion.J.resize(6, static_cast<Index>(size()));
  for (Index row = 0; row < 6; ++row)
    motion.J.row(row) = impl_->coordinates.reduced(VectorXd(all.J.row(row).transpose()));
  return motion;
}

VectorXd RobotDynamics::inverse_dynamics(const VectorXd& acceleration) const {
  impl_->check_numbers("acceleration", acceleration);
  return math::product(impl_->mass, acceleration) + impl_->bias - impl_->passive;
}

VectorXd RobotDynamics::forward_dynamics(const VectorXd& force) const {
  impl_->check_numbers("force", force);
  return impl_->factors().solve(force + impl_->passive - impl_->bias);
}

RobotDynamics::Linearization RobotDynamics::linearize(const VectorXd& force) const {
  impl_->check_numbers("force", force);
  const auto n = static_cast<Index>(size());
  const MassFactors factors = impl_->factors();
  Linearization made;
  made.acceleration = factors.solve(force + impl_->passive - impl_->bias);
  const TreeQuantities::Derivatives of_forces =
      impl_->quantities.derivatives(impl_->coordinates.motions(made.acceleration));
  const MatrixXd by_position =
      -impl_->stiffness - impl_->coordinates.reduced(of_forces.by_position);
  const MatrixXd by_rate = -impl_->damping - impl_->coordinates.reduced(of_forces.by_rate);
  made.A.resize(2 * n, 2 * n);
  made.A << impl_->turning(), MatrixXd::Identity(n, n), factors.solve_all(by_position),
      factors.solve_all(by_rate);
  made.B.resize(2 * n, n);
  made.B << MatrixXd::Zero(n, n), factors.solve_all(MatrixXd::Identity(n, n));
  return made;
}

}  // namespace constraint_sim::engine
