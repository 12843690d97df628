// Reported forces of redundant joints: closed forms by symmetry, and a dense pseudo-inverse in long
// double.

#include <algorithm>
#include <memory>
#include <numeric>

#include "engine/constraints/joint.h"
#include "engine/constraints/prescribed_motion.h"
#include "engine/dynamics/least_norm_forces.h"
#include "engine/math/list.h"
#include "engine/methods/runge_kutta/runge_kutta.h"
#include "engine/model/joint_data.h"
#include "redundant_scenes.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;
using redundant::join;

constexpr Method kAutoAndSmooth[] = {Method::kAuto, Method::kRungeKutta, Method::kEnergyMomentum};

void set_method(World* world, Method method, double time_step) {
  WorldOptions options = world->options();
  options.method = method;
  options.time_step = time_step;
  world->set_options(options);
}

// ---- closed forms

/// A table of 8 kg that hangs on four rods, at (±0.5, ±0.3), one of them redundant.
World hanging_table(double break_force = 0.0) {
  World world;
  const BodyId table =
      world.add_body(redundant::body_at("table", {1.0, 0.6, 0.1}, 8.0, Vector3d::Zero()));
  for (const double x : {-0.5, 0.5}) {
    for (const double y : {-0.3, 0.3}) {
      const JointId id = join(&world, kWorldBody, Vector3d(x, y, 1.0), table, Vector3d(x, y, 0.0));
      Joint joint = world.joint(id);
      if (break_force == 0.0) continue;
      world.remove_joint(id);
      joint.break_force = break_force;
      world.add_joint(joint);
    }
  }
  return world;
}

double force(const World& world, std::size_t j) {
  return world.joint_state(world.joint_ids()[j]).force;
}

// At rest each rod carries a quarter of the weight, by symmetry. With a torque about y the
// least-norm forces for Σ f = m g and Σ x f = T are f = m g/4 + T x/(4 · 0.25 m²). 1e-12: rounding.
TEST(LeastNormForces, OfAHangingTableAreSharedByItsLegs) {
  for (const Method method : kAutoAndSmooth) {
    for (const double torque : {0.0, 4.0}) {
      World world = hanging_table();
      set_method(&world, method, 0.01);
      Wrench wrench;
      wrench.body = world.find_body("table");
      wrench.torque.y() = torque;
      if (torque != 0.0) world.add_wrench(wrench);
      for (int i = 0; i < 3; ++i) EXPECT_EQ(world.step().joints.dependent_rows, 1u);
      const double weight = 8.0 * kGravity;
      for (std::size_t j = 0; j < 4; ++j) {
        const double x = j < 2 ? -0.5 : 0.5;
        EXPECT_NEAR(force(world, j), -(weight / 4.0 + torque * x), 1e-12 * weight)
            << name(method) << ", torque " << torque << ", leg " << j;
      }
    }
  }
}

// Two or three legs alone would carry half of the weight each.
TEST(LeastNormForces, DecideWhatBreaks) {
  const double weight = 8.0 * kGravity;
  for (const Method method : kAutoAndSmooth) {
    for (const double share : {0.26, 0.24}) {
      World world = hanging_table(share * weight);
      set_method(&world, method, 0.01);
      world.step();
      for (const JointId id : world.joint_ids())
        EXPECT_EQ(world.joint_state(id).broken, share < 0.25) << name(method);
    }
  }
}

// Several equal joints carry equal shares of the force of one joint. 1e-7 of the weight: the
// motion's accuracy with the tolerance of 1e-8 m/s.
TEST(LeastNormForces, OfEqualRodsAreEqual) {
  for (const Method method : kAutoAndSmooth) {
    for (const int count : {2, 3}) {
      World alone, shared;
      for (World* world : {&alone, &shared}) {
        set_method(world, method, 0.01);
        const BodyId bob = problems::add_mass(world, "bob", {1.0, 0.0, 0.0});
        for (int k = 0; k < (world == &alone ? 1 : count); ++k)
          join(world, kWorldBody, Vector3d::Zero(), bob, {1.0, 0.0, 0.0});
      }
      for (int i = 0; i < 50; ++i) {
        alone.step();
        shared.step();
        for (std::size_t k = 0; k < shared.joint_ids().size(); ++k)
          ASSERT_NEAR(count * force(shared, k), force(alone, 0), 1e-7 * kGravity)
              << name(method) << " at " << shared.time();
      }
    }
  }
}

// A door on two ball joints, equally far above and below its centre: each carries half of the
// weight, to rounding.
TEST(LeastNormForces, OfADoorAreSharedByItsHinges) {
  for (const Method method : kAutoAndSmooth) {
    World world = redundant::door();
    set_method(&world, method, 0.01);
    for (int i = 0; i < 20; ++i) {
      world.step();
      for (const JointId id : world.joint_ids())
        EXPECT_NEAR(joint_data(world, id).impulse.z() / 0.01, 5.0 * kGravity, 1e-11 * kGravity)
            << name(method);
    }
  }
}

// ---- a dense oracle

using Real = long double;
using Vector = Eigen::Matrix<Real, Eigen::Dynamic, 1>;
using Matrix = Eigen::Matrix<Real, Eigen::Dynamic, Eigen::Dynamic>;
using Vector3 = Eigen::Matrix<Real, 3, 1>;

/// Bodies and joints of a world as one island, by RungeKutta; the world itself is body 0.
class OneIsland {
 public:
  explicit OneIsland(const World& world) : gravity_(world.options().gravity) {
    states.emplace_back();
    masses.emplace_back();
    for (const BodyId id : world.body_ids()) {
      const Body& body = world.body(id);
      states.push_back(world.state(id));
      MassProperties mass;
      mass.inverse_mass = 1.0 / body.mass;
      if (const auto* box = std::get_if<Box>(&body.shape)) {
        const Vector3d s = box->size.cwiseAbs2();
        mass.inertia = body.mass / 12.0 * Vector3d(s.y() + s.z(), s.z() + s.x(), s.x() + s.y());
        mass.inverse_inertia = mass.inertia.cwiseInverse();
      }
      masses.push_back(mass);
    }
    const std::vector<BodyId> ids = world.body_ids();
    const auto index = [&](BodyId id) {
      const auto found = std::find(ids.begin(), ids.end(), id);
      return id == kWorldBody ? 0 : static_cast<std::size_t>(found - ids.begin()) + 1;
    };
    for (const JointId id : world.joint_ids()) {
      joints.push_back(world.joint(id));
      ends.emplace_back(index(joints.back().body_a), index(joints.back().body_b));
      JointData state;
      begin_joint(joints.back(), states[ends.back().first], states[ends.back().second], 0.0, state);
      prescribed_.emplace_back(joints.back(), JointStep{0.0, 0.01, 0.1, 0.5}, state);
      joint_states_.push_back(state);
    }
    List<int> all(joints.size());
    std::iota(all.begin(), all.end(), 0);
    motion_ = std::make_unique<RungeKutta>(EquationsOfMotion(all, joints, ends, masses));
  }

  bool step(double h) {
    motion_->begin_step(joint_states_);
    const Interval interval{t_, h, gravity_, loads_, prescribed_, false, false};
    t_ += h;
    return motion_->advance(interval, {8, 1e-10}, &states).done;
  }
  const EquationsOfMotion& equations() const { return motion_->equations(); }

  List<BodyState> states;
  List<MassProperties> masses;
  List<Joint> joints;
  List<std::pair<std::size_t, std::size_t>> ends;

 private:
  Vector3d gravity_;
  List<AppliedWrench> loads_;
  List<PrescribedMotion> prescribed_;
  List<JointData> joint_states_;
  double t_ = 0.0;
  std::unique_ptr<RungeKutta> motion_;
};

/// Forces and torques of unit impulses on all bodies, a column for each row of a joint, in the
/// order of EquationsOfMotion; and the weights of these rows.
struct Columns {
  Matrix G_T;
  Vector weight, by_mass;  // weights of columns, and inverse weights of rows of Gᵀ

  explicit Columns(const OneIsland& island) {
    const auto n = static_cast<Eigen::Index>(6 * island.states.size());
    List<Vector> columns;
    by_mass.setZero(n);
    for (std::size_t b = 0; b < island.states.size(); ++b) {
      const auto first = static_cast<Eigen::Index>(6 * b);
      const MassProperties& mass = island.masses[b];
      by_mass.segment<3>(first).setConstant(std::sqrt(static_cast<Real>(mass.inverse_mass)));
      by_mass.segment<3>(first + 3) = mass.inverse_inertia.cast<Real>().cwiseSqrt();
    }
    for (const int j : island.equations().joints()) {
      const std::size_t a = island.ends[static_cast<std::size_t>(j)].first;
      const std::size_t b = island.ends[static_cast<std::size_t>(j)].second;
      const Joint& joint = island.joints[static_cast<std::size_t>(j)];
      const Vector3 arm_a = arm(island, a, joint.anchor_a), arm_b = arm(island, b, joint.anchor_b);
      const Vector3 d =
          (island.states[b].position - island.states[a].position).cast<Real>() + arm_b - arm_a;
      const auto add = [&](const Vector3& n_W) {
        Vector column = Vector::Zero(n);
        add_end(island, a, arm_a, -n_W, &column);
        add_end(island, b, arm_b, n_W, &column);
        columns.push_back(column);
      };
      if (joint.kind == JointKind::kBall)
        for (int k = 0; k < 3; ++k) add(Vector3::Unit(k));
      else
        add(d.normalized());
    }
    G_T.resize(n, static_cast<Eigen::Index>(columns.size()));
    weight.resize(G_T.cols());
    for (Eigen::Index c = 0; c < G_T.cols(); ++c) {
      G_T.col(c) = columns[static_cast<std::size_t>(c)];
      weight[c] = by_mass.cwiseProduct(G_T.col(c)).squaredNorm();
    }
    Eigen::Index c = 0;
    for (const int j : island.equations().joints()) {
      const bool is_ball = island.joints[static_cast<std::size_t>(j)].kind == JointKind::kBall;
      if (is_ball) weight.segment<3>(c).setConstant(weight.segment<3>(c).mean());
      c += is_ball ? 3 : 1;
    }
  }

  /// Returns λ of least Σ a λ² that gives the force and torque of `lambda` on each body. √a λ is
  /// the projection of √a `lambda` onto the rows of Gᵀ / √a. Gram and Schmidt's orthogonalization
  /// takes the longest remaining row first.
  Vector least(const Vector& lambda) const {
    const Vector scale = weight.cwiseSqrt(), scaled = scale.cwiseProduct(lambda);
    Matrix rows = (by_mass.asDiagonal() * G_T * scale.cwiseInverse().asDiagonal()).transpose();
    Vector projection = Vector::Zero(scaled.size());
    for (Eigen::Index rank = 0; rank < std::min(rows.rows(), rows.cols()); ++rank) {
      Eigen::Index longest = 0;
      const Real length = rows.colwise().norm().maxCoeff(&longest);
      if (length < 1e-9L) break;  // between rounding and the pivots of the kept rows
      const Vector direction = rows.col(longest) / length;
      projection += direction.dot(scaled) * direction;
      for (Eigen::Index i = 0; i < rows.cols(); ++i)
        rows.col(i) -= direction.dot(rows.col(i)) * direction;
    }
    return projection.cwiseQuotient(scale);
  }

 private:
  static Vector3 arm(const OneIsland& island, std::size_t b, const Vector3d& anchor) {
    return island.states[b].orientation.cast<Real>().normalized() * anchor.cast<Real>();
  }
  // Torques are in principal axes, where the inertia is diagonal.
  static void add_end(const OneIsland& island, std::size_t b, const Vector3& r, const Vector3& f,
                      Vector* column) {
    const auto first = static_cast<Eigen::Index>(6 * b);
    const auto q = island.states[b].orientation.cast<Real>().normalized();
    column->segment<3>(first) += f;
    column->segment<3>(first + 3) += q.conjugate() * r.cross(f);
  }
};

RowVector impulse_of(const LeastNormForces& told, const EquationsOfMotion& equations,
                     std::size_t l) {
  return told.impulse(equations, l);
}
RowVector impulse_of(const EquationsOfMotion& told, const EquationsOfMotion&, std::size_t l) {
  return told.forces().impulse(told, l);
}

template <class Forces>
Vector by_row(const OneIsland& island, const Forces& told) {
  List<Real> rows;
  for (std::size_t l = 0; l < island.equations().joints().size(); ++l) {
    const RowVector impulse = impulse_of(told, island.equations(), l);
    rows.push_back(impulse.x());
    if (!island.equations().is_ball(l)) continue;
    rows.push_back(impulse.y());
    rows.push_back(impulse.z());
  }
  return Eigen::Map<Vector>(rows.data(), static_cast<Eigen::Index>(rows.size()));
}

// Bound 1e-10 of the largest: states accurate to 1e-16 of the scene change λ by that over the
// smallest pivot, 1e-3 and more here, and factors in double lose as much again. Sums on each body:
// 1e-13.
TEST(LeastNormForces, AreThoseOfThePseudoInverse) {
  const std::pair<const char*, World> scenes[] = {{"dome", redundant::dome()},
                                                  {"bricard", redundant::bricard()},
                                                  {"bennett", redundant::bennett()},
                                                  {"door", redundant::door()},
                                                  {"table", hanging_table()}};
  for (const auto& [name, world] : scenes) {
    OneIsland island(world);
    LeastNormForces told(island.equations());
    for (int i = 0; i < 5; ++i) {
      ASSERT_TRUE(island.step(0.01)) << name;
      ASSERT_GT(island.equations().delassus().redundant(), 0u) << name;
      told.share(island.equations(), island.states);
      const Vector motion = by_row(island, island.equations());
      const Vector shared = by_row(island, told);
      const Columns columns(island);
      const Vector least = columns.least(motion);
      const Real most = motion.cwiseAbs().maxCoeff();
      EXPECT_LE((shared - least).cwiseAbs().maxCoeff(), 1e-10L * most) << name << ", step " << i;
      Vector sum = columns.G_T * (shared - motion);
      sum.head<6>().setZero();  // the world carries any force
      EXPECT_LE(sum.cwiseAbs().maxCoeff(), 1e-13L * most) << name << ", step " << i;
      // the forces of the motion are not the least ones
      EXPECT_GT((motion - least).cwiseAbs().maxCoeff(), 1e-3L * most) << name << ", step " << i;
    }
  }
}

// A spring beside redundant rods reports its own force.
TEST(LeastNormForces, LeaveSpringsAsTheyAre) {
  for (const Method method : kAutoAndSmooth) {
    World world = hanging_table();
    DistanceJoint spring;
    spring.stiffness = 100.0;
    spring.length = 0.9;
    join(&world, kWorldBody, {0.0, 0.0, 1.0}, world.find_body("table"), Vector3d::Zero(), spring);
    set_method(&world, method, 0.01);
    world.step();
    const double weight = 8.0 * kGravity;
    EXPECT_NEAR(force(world, 4), -10.0, 1e-11 * weight) << name(method);
    for (std::size_t j = 0; j < 4; ++j)
      EXPECT_NEAR(force(world, j), -(weight - 10.0) / 4.0, 1e-11 * weight) << name(method);
  }
}

}  // namespace
}  // namespace constraint_sim::engine
