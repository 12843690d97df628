// Dynamics of robots for controllers: random trees against the rows of their joints, against the
// velocities of their bodies, and against differences of poses.

#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "constraint_sim/engine/robot_dynamics.h"
#include "displaced_robots.h"
#include "engine/dynamics/equations_of_motion.h"
#include "engine/dynamics/state_vector.h"
#include "engine/islands/topology.h"
#include "engine/world/world_impl.h"
#include "random_tree.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Eigen::VectorXd;

const int kSeeds = 400 / kSeedShare;

/// Returns a tree without motors, whose velocities fit the joints after a step; none where its
/// joints do not form a robot.
std::optional<World> robot_of(int seed, double far = 0.0) {
  RandomTree tree = random_tree(seed, far);
  for (RandomTree::Link& link : tree.links)
    for (CoordinateLaw& law : link.joint.coordinates) law.motor.reset();
  World world = tree.world();
  EXPECT_FALSE(world.step().outcome.failed);
  const std::string why =
      refusal([&] { RobotDynamics(world, world.find_body(tree.bodies.back().name)); });
  if (why.empty()) return world;
  EXPECT_TRUE(why.find("farther from the base") != std::string::npos ||
              why.find("no coordinate") != std::string::npos ||
              why.find("leaves a coordinate free") != std::string::npos)
      << why;
  return {};
}

double largest(const MatrixXd& M) { return M.size() == 0 ? 0.0 : M.cwiseAbs().maxCoeff(); }

Vector6d twist_at(const BodyState& state, const Vector3d& point) {
  Vector6d twist;
  twist << state.linear_velocity + state.angular_velocity.cross(state.orientation * point),
      state.angular_velocity;
  return twist;
}

/// Calls `act(world)` with random robots.
template <class Act>
void for_each_robot(const Act& act) {
  int count = 0;
  for (int seed = 0; seed < kSeeds; ++seed) {
    SCOPED_TRACE(seed);
    const std::optional<World> world = robot_of(seed);
    if (!world) continue;
    ++count;
    act(*world);
  }
  EXPECT_GE(count, kSeeds * 2 / 3);
}

// ---- against the bodies

// The twists of bodies follow from the coordinates' rates to rounding of the joints' rows, which
// held before the bodies were written: speeds up to 100 m/s and rad/s.
TEST(RobotDynamics, VelocitiesAreThoseOfTheBodies) {
  Random random;
  for_each_robot([&](const World& world) {
    const RobotDynamics robot = last_robot(world);
    EXPECT_LE(robot.pose_error(), 1e-11);
    for (const BodyId body : robot.bodies()) {
      const Vector3d point = random.vector();
      const RobotDynamics::PointMotion motion = robot.motion_of(body, point);
      const Vector6d twist = twist_at(world.state(body), point);
      const double bound = 1e-11 * (1.0 + twist.norm());
      EXPECT_LE((motion.velocity - twist).norm(), bound);
      if (is_on_base(world)) continue;  // the base adds to the velocities
      EXPECT_LE((motion.J * robot.velocity() - twist).norm(), bound);
    }
  });
}

// Coordinates are those that joints report, to the rounding of a step that wrote the bodies.
TEST(RobotDynamics, CoordinatesAreThoseOfTheJoints) {
  for_each_robot([&](const World& world) {
    const RobotDynamics robot = last_robot(world);
    for (const RobotCoordinate& coordinate : robot.coordinates()) {
      if (!coordinate.joint || coordinate.coordinate < 0) continue;
      const CoordinateState& state =
          world.joint_state(*coordinate.joint).coordinates[to_index(coordinate.coordinate)];
      EXPECT_NEAR(coordinate.position, state.position, 1e-12 * (1.0 + std::abs(state.position)))
          << coordinate.name;
      EXPECT_NEAR(coordinate.velocity, state.velocity, 1e-10 * (1.0 + std::abs(state.velocity)))
          << coordinate.name;
    }
    for (const RobotFollower& follower : robot.followers()) {
      const double rate =
          world.joint_state(follower.joint).coordinates[to_index(follower.coordinate)].velocity;
      const double leader = robot.coordinates()[follower.leader].velocity;
      EXPECT_NEAR(rate, follower.ratio * leader, 1e-9 * (1.0 + std::abs(rate)));
    }
  });
}

/// Accelerations of all bodies by the rows of the joints in maximal coordinates.
Motions accelerations_by_rows(const World& world, const List<AppliedWrench>& loads,
                              List<int>* bodies) {
  const WorldImpl& impl = ImplAccess::of(world);
  List<int> all;
  List<JointEnds> ends;
  List<CoupledTerms> couplings;
  List<PrescribedMotion> motions;
  List<JointData> states = impl.joint_states;
  for (std::size_t j = 0; j < impl.joints.size(); ++j) {
    all.push_back(static_cast<int>(j));
    ends.push_back(ends_of(impl, impl.joints[j]));
    couplings.push_back(info(impl.joints[j].kind).couples ? impl.terms_of(j) : CoupledTerms{});
    motions.emplace_back(impl.joints[j], JointStep{impl.time(), 0.01, 0.1, 0.0}, states[j]);
  }
  EquationsOfMotion equations(all, impl.joints, ends, impl.masses, couplings);
  equations.begin_step(states);
  equations.begin(impl.time(), impl.states, impl.options.gravity, loads, motions);
  List<double> y(equations.size()), dydt(equations.size());
  gather_state(equations, impl.states, y.data());
  EXPECT_TRUE(equations.start(impl.time(), y.data(), dydt.data()));
  Motions found;
  find_accelerations(equations, y.data(), dydt.data(), &found);
  *bodies = equations.bodies();
  return found;
}

// A wrench on the last body acts as Jᵀ times itself. Rows lose digits by masses over six decades;
// where they do, in fewer than 2 of 100 trees, the trees differ by more.
TEST(RobotDynamics, AccelerationsAreThoseOfTheRows) {
  Random random;
  int apart = 0, count = 0;
  for_each_robot([&](const World& world) {
    const RobotDynamics robot = last_robot(world);
    const WorldImpl& impl = ImplAccess::of(world);
    AppliedWrench load{};
    load.body = static_cast<int>(impl.bodies.size()) - 1;
    load.force = random.vector() / impl.masses[load.body].inverse_mass;
    load.torque = impl.masses[load.body].inertia.minCoeff() * random.vector();
    List<int> bodies;
    const Motions rows = accelerations_by_rows(world, {load}, &bodies);
    Vector6d wrench;
    wrench << load.force, load.torque;
    const VectorXd force = robot.motion_of(world.body_ids().back()).J.transpose() * wrench;
    const VectorXd qdd = robot.forward_dynamics(force);
    double size = 0.0, off = 0.0;
    for (std::size_t i = 0; i < bodies.size(); ++i) {
      const auto motion = robot.motion_of(impl.body_ids[to_index(bodies[i])]);
      const Vector6d a = motion.J * qdd + motion.bias;
      Vector6d by_rows;
      by_rows << rows.linear[i], rows.angular[i];
      size = std::max(size, by_rows.norm());
      off = std::max(off, (a - by_rows).norm());
    }
    ++count;
    apart += off > 1e-7 * (1.0 + size) ? 1 : 0;
    EXPECT_LE((robot.inverse_dynamics(qdd) - force).norm(),
              1e-9 * (1.0 + largest(force) + largest(robot.bias())));
  });
  EXPECT_LE(apart, count / 50);
}

// ---- against differences of poses

double potential_energy(const World& world) {
  double energy = 0.0;
  const RobotDynamics robot = last_robot(world);
  for (const BodyId id : robot.bodies())
    energy -= world.body(id).mass * world.options().gravity.dot(world.state(id).position);
  return energy;
}

// Tolerance: rounding of poses, 1e-15 over 1e-3, and the error of slope().
TEST(RobotDynamics, JacobiansAndGravityAreSlopesOfPoses) {
  Random random;
  for_each_robot([&](const World& world) {
    const RobotDynamics robot = last_robot(world);
    const BodyId last = world.body_ids().back();
    const BodyState at = world.state(last);
    const Vector3d point = random.vector();
    const MatrixXd J = robot.motion_of(last, point).J;
    double weights = 0.0;
    for (const BodyId id : robot.bodies()) weights += world.body(id).mass * kGravity;
    for (Index k = 0; k < J.cols(); ++k) {
      const VectorXd slopes = slope(
          [&](double h) {
            const World moved = displaced(world, robot, VectorXd::Unit(J.cols(), k), h);
            const BodyState to = moved.state(last);
            VectorXd values(8);
            values << to.position + to.orientation * point,
                rotation_vector(to.orientation * at.orientation.conjugate()),
                potential_energy(moved), last_robot(moved).position()[k];
            return values;
          },
          speed_of(robot, k));
      EXPECT_LE((slopes.head<6>() - J.col(k)).norm(), 1e-9 * (1.0 + J.col(k).norm())) << k;
      EXPECT_NEAR(slopes[6], robot.gravity()[k], 1e-8 * (1.0 + weights)) << k;
      if (std::isnan(robot.position()[k])) continue;
      EXPECT_NEAR(slopes[7], 1.0, 1e-9) << k;
    }
  });
}

// Tolerances are relative to the largest entry of a column and acceleration. Accelerations of light
// bodies lose six digits and more to the inertia of heavy ones, and slope() divides their rounding
// by 1e-3: this is the error of slope(), and few columns have more than 1e-8.
TEST(RobotDynamics, LinearizationIsTheSlopeOfForwardDynamics) {
  int columns = 0, rounded = 0;
  Random random;
  for_each_robot([&](const World& world) {
    const RobotDynamics robot = last_robot(world);
    const auto n = static_cast<Index>(robot.size());
    VectorXd force = robot.gravity();
    for (Index k = 0; k < n; ++k) force[k] += random() * robot.mass_matrix()(k, k);
    const RobotDynamics::Linearization by = robot.linearize(force);
    EXPECT_EQ(by.acceleration, robot.forward_dynamics(force));
    const VectorXd rates = robot.velocity();
    for (Index k = 0; k < n; ++k) {
      const VectorXd by_position = slope(
          [&](double h) {
            World moved = displaced(world, robot, VectorXd::Unit(n, k), h);
            return moving(&moved, rates).forward_dynamics(force);
          },
          speed_of(robot, k));
      const VectorXd by_rate = slope(
          [&](double h) {
            World same = world;
            return moving(&same, rates + h * VectorXd::Unit(n, k)).forward_dynamics(force);
          },
          speed_of(robot, k));
      const VectorXd off_position = by.A.col(k).tail(n) - by_position;
      const VectorXd off_rate = by.A.col(n + k).tail(n) - by_rate;
      const double scale = 1.0 + largest(by.acceleration);
      for (const auto& [off, size] : {std::pair(largest(off_position), largest(by_position)),
                                      std::pair(largest(off_rate), largest(by_rate))}) {
        EXPECT_LE(off, 2e-5 * (scale + size)) << k;
        ++columns;
        rounded += off > 1e-8 * (scale + size) ? 1 : 0;
      }
      EXPECT_EQ(by.B.col(k).head(n), VectorXd::Zero(n));
      const VectorXd unit = robot.mass_matrix() * by.B.col(k).tail(n);
      EXPECT_LE((unit - VectorXd::Unit(n, k)).norm(), 1e-7) << k;
    }
    EXPECT_EQ(by.A.topRightCorner(n, n), MatrixXd::Identity(n, n));
  });
  EXPECT_LE(rounded, columns / 5);
}

// Lagrange's equations: b − g = Ṁ q̇ − ½ ∂(q̇ᵀ M q̇)/∂q, which Ṁ − 2 C being skew is part of. On
// bases at rest, for coordinates that are positions.
TEST(RobotDynamics, BiasFollowsFromTheMassMatrix) {
  int count = 0;
  for_each_robot([&](const World& world) {
    const RobotDynamics robot = last_robot(world);
    if (is_on_base(world) || robot.position().hasNaN()) return;
    ++count;
    const auto n = static_cast<Index>(robot.size());
    const VectorXd rates = robot.velocity();
    const VectorXd rising = slope([&](double h) {
      return VectorXd(last_robot(displaced(world, robot, rates, h)).mass_matrix() * rates);
    });
    VectorXd kinetic(n);
    for (Index k = 0; k < n; ++k)
      kinetic[k] = slope(
          [&](double h) {
            const World moved = displaced(world, robot, VectorXd::Unit(n, k), h);
            const MatrixXd M = last_robot(moved).mass_matrix();
            return VectorXd(VectorXd::Constant(1, 0.5 * rates.dot(M * rates)));
          },
          speed_of(robot, k))[0];
    const VectorXd bias = robot.bias() - robot.gravity();
    EXPECT_LE(largest(rising - kinetic - bias), 1e-7 * (1.0 + largest(bias) + largest(kinetic)));
  });
  EXPECT_GE(count, kSeeds / 20);
}

// The kinetic energy of the bodies, from their own inertias.
TEST(RobotDynamics, MassMatrixHasTheKineticEnergy) {
  for_each_robot([&](const World& world) {
    if (is_on_base(world)) return;  // the base adds to the velocities
    const RobotDynamics robot = last_robot(world);
    double energy = 0.0;
    for (const BodyId id : robot.bodies()) {
      const BodyState& state = world.state(id);
      const Vector3d w = state.orientation.conjugate() * state.angular_velocity;
      energy += 0.5 * world.body(id).mass * state.linear_velocity.squaredNorm() +
                0.5 * w.dot(inertia_of(world.body(id)).cwiseProduct(w));
    }
    const VectorXd rates = robot.velocity();
    EXPECT_NEAR(0.5 * rates.dot(robot.mass_matrix() * rates), energy, 1e-11 * energy);
    EXPECT_EQ(robot.mass_matrix(), robot.mass_matrix().transpose());
  });
}

// Poses at 1 km are rounded to 1e-13 m, which velocities of light bodies enlarge.
TEST(RobotDynamics, IsAsExactFarFromTheOrigin) {
  for (int seed = 0; seed < kSeeds; ++seed) {
    SCOPED_TRACE(seed);
    const std::optional<World> near = robot_of(seed), far = robot_of(seed, 1000.0);
    ASSERT_EQ(near.has_value(), far.has_value());
    if (!near) continue;
    const RobotDynamics here = last_robot(*near), there = last_robot(*far);
    const MatrixXd& M = here.mass_matrix();
    EXPECT_LE(largest(M - there.mass_matrix()), 1e-9 * largest(M));
    EXPECT_LE(largest(here.bias() - there.bias()), 1e-8 * (1.0 + largest(here.bias())));
  }
}

// A query neither changes the world nor what it does next.
TEST(RobotDynamics, LeavesTheWorldAsItIs) {
  for_each_robot([&](const World& world) {
    World asked = world, left = world;
    for (int i = 0; i < 5; ++i) {
      const std::uint64_t before = asked.state_hash();
      const RobotDynamics robot = last_robot(asked);
      robot.linearize(robot.gravity());
      robot.motion_of(asked.body_ids().back());
      EXPECT_EQ(asked.state_hash(), before);
      asked.step();
      left.step();
      EXPECT_EQ(asked.state_hash(), left.state_hash());
    }
  });
}

}  // namespace
}  // namespace constraint_sim::engine
