// The kernel for chains of bodies against the general equations, and its elimination against dense
// solutions.

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <array>
#include <numeric>

#include "engine/dynamics/kernels/chain_of_bodies.h"
#include "engine/math/block_pivot.h"
#include "engine/math/list.h"
#include "problems.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kChainTimeStep = 0.01;  // [s]

/// Random bodies, each hung on the previous one by a ball joint with either body as A; bodies and
/// joints in any order. A held end is on a body that moves at constant velocity.
struct Chain {
  Chain(std::size_t links, bool holds_first, bool holds_last, Random& random) {
    List<std::size_t> place(links + 1);  // index in the lists of each body along the chain
    std::iota(place.begin(), place.end(), 0);
    const auto shuffle = [&](auto& list) {
      for (std::size_t i = list.size(); i-- > 1;)
        std::swap(
            list[i],
            list[static_cast<std::size_t>(0.5 * (random() + 1.0) * static_cast<double>(i + 1))]);
    };
    shuffle(place);
    masses.resize(links + 1);
    states.resize(links + 1);
    for (std::size_t i = 0; i <= links; ++i) {
      const auto body = static_cast<int>(place[i]);
      states[place[i]] = random.state();
      if ((i == 0 && holds_first) || (i == links && holds_last)) continue;
      MassProperties& mass = masses[place[i]];
      mass.inverse_mass = 1.0 / (1.5 + random());
      mass.inertia = (Vector3d::Constant(1.5) + random.vector()) / (10.0 * mass.inverse_mass);
      mass.inverse_inertia = mass.inertia.cwiseInverse();
      loads.push_back({body, random.vector(), 0.1 * random.vector()});
    }
    for (std::size_t i = 0; i < links; ++i) {
      std::size_t a = place[i], b = place[i + 1];
      Joint joint;
      joint.kind = JointKind::kBall;
      joint.anchor_a = random.vector();
      joint.anchor_b = random.vector();
      states[b].position = states[a].position + states[a].orientation * joint.anchor_a -
                           states[b].orientation * joint.anchor_b;
      if (random() > 0.0) {
        std::swap(a, b);
        std::swap(joint.anchor_a, joint.anchor_b);
      }
      joints.push_back(joint);
      ends.emplace_back(a, b);
      JointData state;
      prescribed.emplace_back(joint, JointStep{0.0, kChainTimeStep, 0.0, 0.5}, state);
    }
    order.resize(links);
    std::iota(order.begin(), order.end(), 0);
    shuffle(order);
  }

  EquationsOfMotion equations() const { return {order, joints, ends, masses}; }

  List<MassProperties> masses;
  List<BodyState> states;
  List<Joint> joints;
  List<std::pair<std::size_t, std::size_t>> ends;
  List<AppliedWrench> loads;
  List<PrescribedMotion> prescribed;
  List<int> order;
};

/// A chain's equations, started, and advanced by one System or another.
class Motion {
 public:
  explicit Motion(const Chain& chain)
      : equations(chain.equations()), numbers_(StageMemory::kRows * equations.size()) {
    gather_state(equations, chain.states, y());
    equations.begin(0.0, chain.states, {0.0, 0.0, -kGravity}, chain.loads, chain.prescribed);
    EXPECT_TRUE(equations.start(0.0, y(), memory().derivatives()));
  }

  StageMemory memory() { return {numbers_.data(), equations.size()}; }
  double* y() { return memory().state(); }
  VectorXd state() { return VectorXd::Map(y(), static_cast<Eigen::Index>(equations.size())); }

  template <class System>
  VectorXd derivative(double t) {
    VectorXd rates = VectorXd::Zero(static_cast<Eigen::Index>(equations.size()));
    System system{equations};
    system.derivative(1, t, y(), rates.data());
    return rates;
  }
  template <class System>
  void advance(double duration) {
    System system{equations};
    double step = kChainTimeStep;
    EXPECT_TRUE(integrate<DormandPrince8>(system, memory(), 0.0, duration, 0.0, step).done);
  }

  EquationsOfMotion equations;

 private:
  List<double> numbers_;
};

/// Calls `check` with chains of all combinations of ends.
template <class Check>
void for_chains(const Check& check) {
  Random random;
  for (const std::size_t links : {1, 2, 3, 4, 5, 6, 9, 20, 51}) {
    for (const bool holds_first : {false, true}) {
      for (const bool holds_last : {false, true}) {
        if (holds_first && holds_last && links < 4) continue;  // rows depend on each other
        for (int i = 0; i < 2; ++i) {
          const Chain chain(links, holds_first, holds_last, random);
          SCOPED_TRACE(testing::Message() << links << holds_first << holds_last << i);
          check(chain);
        }
      }
    }
  }
}

// Equal up to rounding, which the masses and arms of these chains amplify to some 1e-13.
TEST(ChainOfBodies, HasTheDerivativeOfTheEquations) {
  for_chains([](const Chain& chain) {
    Motion expected(chain), motion(chain);
    ASSERT_TRUE(motion.equations.is_chain_of_bodies());
    const VectorXd rates = expected.derivative<EquationsOfMotion&>(0.3 * kChainTimeStep);
    const VectorXd difference = motion.derivative<ChainOfBodies>(0.3 * kChainTimeStep) - rates;
    EXPECT_LE(difference.lpNorm<Eigen::Infinity>(), 1e-12 * rates.lpNorm<Eigen::Infinity>());
  });
}

TEST(ChainOfBodies, StepsAsTheEquationsDo) {
  for_chains([](const Chain& chain) {
    Motion expected(chain), motion(chain);
    expected.advance<EquationsOfMotion&>(kChainTimeStep);
    motion.advance<ChainOfBodies>(kChainTimeStep);
    const VectorXd state = expected.state();
    EXPECT_LE((motion.state() - state).lpNorm<Eigen::Infinity>(),
              1e-12 * state.lpNorm<Eigen::Infinity>());
    EXPECT_NEAR(motion.equations.frequency(), expected.equations.frequency(),
                1e-11 * expected.equations.frequency());
    EXPECT_EQ(motion.equations.delassus().dependent(), 0);
    double largest = 0.0, difference = 0.0;
    for (std::size_t l = 0; l < chain.joints.size(); ++l) {
      const RowVector impulse = expected.equations.forces().impulse(expected.equations, l);
      largest = std::max(largest, impulse.norm());
      difference = std::max(
          difference, (motion.equations.forces().impulse(motion.equations, l) - impulse).norm());
    }
    EXPECT_LE(difference, 1e-11 * largest);
  });
}

// A body held at two points has a redundant row: the general equations solve it, to the bit.
TEST(ChainOfBodies, LeavesRowsThatDependToTheEquations) {
  Random random;
  Chain chain(2, true, true, random);
  for (BodyState& state : chain.states) {
    state.linear_velocity.setZero();
    state.angular_velocity.setZero();
  }
  Motion expected(chain), motion(chain);
  ASSERT_TRUE(motion.equations.is_chain_of_bodies());
  for (int i = 0; i < 10; ++i) {
    expected.advance<EquationsOfMotion&>(kChainTimeStep);
    motion.advance<ChainOfBodies>(kChainTimeStep);
  }
  EXPECT_EQ(motion.state(), expected.state());
  EXPECT_EQ(motion.equations.delassus().dependent(), 1);
}

TEST(ChainOfBodies, KeepsJointsAndEnergy) {
  for (const int links : {1, 2, 9, 10}) {
    World world = problems::chain_of_bars(links);
    WorldOptions options = world.options();
    options.method = Method::kRungeKutta;
    options.time_step = 0.01;
    options.tolerance = 1e-9;
    world.set_options(options);
    for (int i = 0; i < 300 / kSeedShare; ++i) {
      const StepReport& report = world.step();
      ASSERT_EQ(report.joints.dependent_rows, 0);
      ASSERT_LE(report.joints.max_error, 1e-12 + 4.0 * kEpsilon * links) << i;
      ASSERT_LE(std::abs(report.energy.drift), 1e-8) << i;  // energy drift by the tolerance
    }
  }
}

// ---- BlockPivot

Lanes33 in_lanes(const Matrix3d& first, const Matrix3d& second) {
  Lanes33 both;
  for (Eigen::Index i = 0; i < 9; ++i) both.data()[i] = Lanes(first.data()[i], second.data()[i]);
  return both;
}

Lanes3 in_lanes(const Vector3d& first, const Vector3d& second) {
  return {Lanes(first[0], second[0]), Lanes(first[1], second[1]), Lanes(first[2], second[2])};
}

Matrix3d random_matrix(Random& random) {
  Matrix3d M;
  M << random.vector(), random.vector(), random.vector();
  return M;
}

TEST(BlockPivot, SolvesTwoBlocksAsADenseMatrixDoesInEachLane) {
  Random random;
  std::array<MatrixXd, 2> A;
  std::array<VectorXd, 2> b;
  for (std::size_t lane : {0, 1}) {
    const MatrixXd B = MatrixXd::NullaryExpr(6, 6, [&] { return random(); });
    A[lane] = B * B.transpose() + MatrixXd::Identity(6, 6);
    b[lane] = VectorXd::NullaryExpr(6, [&] { return random(); });
  }
  const auto block = [&](Eigen::Index i, Eigen::Index j) {
    return in_lanes(Matrix3d(A[0].block<3, 3>(i, j)), Matrix3d(A[1].block<3, 3>(i, j)));
  };
  const auto part = [&](Eigen::Index i) {
    return in_lanes(Vector3d(b[0].segment<3>(i)), Vector3d(b[1].segment<3>(i)));
  };
  BlockPivot first, second;
  first.factor(block(0, 0), 0.0, block(0, 0).diagonal());
  second.factor(block(3, 3) - first.couple(block(3, 0)), 0.0, block(3, 3).diagonal());
  second.reduce(part(3) - first.reduce(part(0)));
  const Lanes3 x_second = second.substitute(Lanes3::Constant(0.0));
  const Lanes3 x_first = first.substitute(x_second);
  for (std::size_t lane : {0, 1}) {
    const auto of_lane = [&](Lanes x) { return lane == 0 ? x.first() : x.second(); };
    VectorXd x(6);
    for (Eigen::Index i = 0; i < 3; ++i) {
      x[i] = of_lane(x_first[i]);
      x[3 + i] = of_lane(x_second[i]);
    }
    EXPECT_LE((A[lane] * x - b[lane]).norm(), 1e-13);
  }
}

TEST(BlockPivot, TellsInWhichLaneAPivotIsTooSmall) {
  Random random;
  const Matrix3d B = random_matrix(random);
  const Matrix3d regular = B * B.transpose();
  for (Eigen::Index row = 0; row < 3; ++row) {
    Matrix3d C = B;
    C.row(row) *= 0.0;
    if (row > 0) C.row(row) = 2.0 * C.row(row - 1);
    const Lanes33 S = in_lanes(regular, Matrix3d(C * C.transpose()));
    BlockPivot pivot;
    const Lanes::Mask is_above = pivot.factor(S, 1e-8, S.diagonal());
    EXPECT_NE(is_above[0], 0);
    EXPECT_EQ(is_above[1], 0) << row;
  }
}

}  // namespace
}  // namespace constraint_sim::engine
