// All kinds of joints, by iteration over their table: rows against finite differences and their own
// steps, motion in free space by each method, closed forms, redundant mechanisms, rejections.

#include <functional>

#include "constraint_sim/engine/scene.h"
#include "dense_systems.h"
#include "engine/constraints/joint_kinds.h"
#include "random_joints.h"
#include "rotation_between.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr int kJointKindTrials = 50;

PairPose closed_pose(const Joint& joint, Random* random) {
  const BodyState a = random->state();
  return {a, attached(joint, a, random)};
}

const ScalarForm& form_of(const Joint& joint, int row) {
  return forms(joint.kind).function[static_cast<std::size_t>(row)];
}

double value_at(const Joint& joint, int row, const PairPose& pose) {
  return value(form_of(joint, row), JointVectors(joint, pose.a, pose.b));
}

/// Calls `check` for all rows and coordinates of random joints of all kinds, at random poses that
/// do not satisfy them; angles only where their vectors are not nearly normal to the plane of
/// rotation, where all derivatives are large.
void for_each_row(
    const std::function<void(const Joint&, int row, const PairPose&, const std::string&)>& check) {
  Random random;
  for (const JointKind kind : joint_kinds()) {
    for (int trial = 0; trial < kJointKindTrials; ++trial) {
      const Joint joint = random_joint(kind, &random);
      const PairPose pose{random.state(), random.state()};
      for (int k = 0; k < forms(kind).rows + forms(kind).coordinates; ++k) {
        const ScalarForm& form = form_of(joint, k);
        if (form.is_angle) {
          const auto at = values(form.angle, JointVectors(joint, pose.a, pose.b));
          if (std::hypot(at.c, at.s) < 0.5 || at.c < -0.8) continue;
        }
        check(joint, k, pose, std::string(name(kind)) + " row " + std::to_string(k));
      }
    }
  }
}

// ---- rows

// Fourth-order differences over 1e-3 have an error of 1e-12 of a fifth derivative of about ten, and
// rounding of 1e-15 over the step.
TEST(JointRows, JacobianIsTheGradient) {
  constexpr double kStep = 1e-3, kTolerance = 2e-10;
  for_each_row([&](const Joint& joint, int row, const PairPose& pose, const std::string& which) {
    const Jacobian J = jacobian(form_of(joint, row), {joint, pose.a, pose.b});
    const auto slope = [&](const Vector3d& v_A, const Vector3d& w_A, const Vector3d& v_B,
                           const Vector3d& w_B) {
      const auto C = [&](double t) {
        return value_at(joint, row, {moved(pose.a, v_A, w_A, t), moved(pose.b, v_B, w_B, t)});
      };
      return (8.0 * (C(kStep) - C(-kStep)) - (C(2.0 * kStep) - C(-2.0 * kStep))) / (12.0 * kStep);
    };
    const Vector3d zero = Vector3d::Zero();
    for (int i = 0; i < 3; ++i) {
      const Vector3d e = Vector3d::Unit(i);
      ASSERT_NEAR(J.j1[i], slope(e, zero, zero, zero), kTolerance) << which;
      ASSERT_NEAR(J.j2[i], slope(zero, e, zero, zero), kTolerance) << which;
      ASSERT_NEAR(J.j3[i], slope(zero, zero, e, zero), kTolerance) << which;
      ASSERT_NEAR(J.j4[i], slope(zero, zero, zero, e), kTolerance) << which;
    }
  });
}

// Without accelerations Ċ is the rate and C̈ is γ: fourth-order differences, over a step at which
// 1e-16/h² and h⁴ of a sixth derivative of a thousand are equal.
TEST(JointRows, RateAndGammaAreTheDerivativesByTime) {
  constexpr double kStep = 2e-3, kTolerance = 5e-8;
  for_each_row([&](const Joint& joint, int row, const PairPose& pose, const std::string& which) {
    const auto C = [&](double t) {
      const auto at = [&](const BodyState& s) {
        return moved(s, s.linear_velocity, s.angular_velocity, t);
      };
      return value_at(joint, row, {at(pose.a), at(pose.b)});
    };
    const double h = kStep;
    const double first = (8.0 * (C(h) - C(-h)) - (C(2.0 * h) - C(-2.0 * h))) / (12.0 * h);
    const double second =
        (16.0 * (C(h) + C(-h)) - (C(2.0 * h) + C(-2.0 * h)) - 30.0 * C(0.0)) / (12.0 * h * h);
    const ScalarForm& form = form_of(joint, row);
    const JointVectors vectors(joint, pose.a, pose.b);
    const JointMotion motion(vectors, pose.a, pose.b);
    ASSERT_NEAR(rate(form, vectors, motion), first, kTolerance) << which;
    ASSERT_NEAR(gamma(form, vectors, motion), second, kTolerance) << which;
    const Jacobian J = jacobian(form, vectors);
    ASSERT_NEAR(J.times(pose.a.linear_velocity, pose.a.angular_velocity, pose.b.linear_velocity,
                        pose.b.angular_velocity),
                rate(form, vectors, motion), 1e-13)  // rounding of a dozen products
        << which;
  });
}

// For bodies rotated by Cayley's map of w, J at the means of the vectors times the step is C₁ − C₀.
TEST(JointRows, JacobianAtTheMeansIsTheDiscreteGradient) {
  Random random;
  for_each_row([&](const Joint& joint, int row, const PairPose& pose, const std::string& which) {
    PairPose end = pose;
    std::array<Vector3d, 4> step;  // displacement and w, of A and B
    for (Vector3d& part : step) part = random.vector();
    const auto turned = [](const Quaterniond& q, const Vector3d& w) {
      const Quaterniond turn(1.0, 0.5 * w.x(), 0.5 * w.y(), 0.5 * w.z());
      return (turn * q).normalized();
    };
    end.a.position += step[0];
    end.a.orientation = turned(pose.a.orientation, step[1]);
    end.b.position += step[2];
    end.b.orientation = turned(pose.b.orientation, step[3]);
    const JointVectors start(joint, pose.a, pose.b), stop(joint, end.a, end.b);
    const Jacobian J = discrete_gradient(form_of(joint, row), start, stop);
    double change = value_at(joint, row, end) - value_at(joint, row, pose);
    if (form_of(joint, row).is_angle) change = unwound(change, 0.0);
    ASSERT_NEAR(J.times(step[0], step[1], step[2], step[3]), change, 1e-13) << which;
  });
}

// Rows are zero where only free coordinates have moved, and independent there: rows and free
// coordinates span all six directions. Least singular values found are above 0.3 for arms of a
// metre.
TEST(JointRows, HoldAllThatIsNotFree) {
  Random random;
  for (const JointKind kind : joint_kinds()) {
    if (kind == JointKind::kDistance) continue;
    for (int trial = 0; trial < kJointKindTrials; ++trial) {
      const Joint joint = random_joint(kind, &random);
      const PairPose pose = closed_pose(joint, &random);
      const JointVectors vectors(joint, pose.a, pose.b);
      Eigen::MatrixXd G(forms(kind).rows, 12);
      for (int k = 0; k < forms(kind).rows; ++k) {
        EXPECT_NEAR(value_at(joint, k, pose), 0.0, 1e-14) << name(kind) << " row " << k;
        const Jacobian J = jacobian(forms(kind).row[static_cast<std::size_t>(k)], vectors);
        G.row(k) << J.j1.transpose(), J.j2.transpose(), J.j3.transpose(), J.j4.transpose();
      }
      EXPECT_EQ(dense_rank(G, 0.01), forms(kind).rows) << name(kind);
      EXPECT_LE(misalignment(forms(kind).alignment, vectors).norm(), 1e-7) << name(kind);
    }
  }
}

// Rotating B by the misalignment aligns it, at any angle.
TEST(JointRows, MisalignmentIsTheWayHome) {
  Random random;
  for (const JointKind kind : joint_kinds()) {
    if (forms(kind).alignment == Alignment::kFree) continue;
    for (int trial = 0; trial < kJointKindTrials; ++trial) {
      const Joint joint = random_joint(kind, &random);
      PairPose pose{random.state(), random.state()};
      const Vector3d rotation =
          misalignment(forms(kind).alignment, JointVectors(joint, pose.a, pose.b));
      const Quaterniond frame_B = pose.b.orientation * *joint.frame_b;
      if (rotation.norm() > 0.0)
        pose.b.orientation = frame_B * Eigen::AngleAxisd(rotation.norm(), rotation.normalized()) *
                             joint.frame_b->conjugate();
      // a rotation by nearly zero has an angle computed from a cosine
      EXPECT_LE(misalignment(forms(kind).alignment, JointVectors(joint, pose.a, pose.b)).norm(),
                1e-7)
          << name(kind) << " " << rotation.norm();
    }
  }
}

// ---- motion in free space

/// Two boxes in a joint of this kind, in free space, moving as the joint allows.
World free_pair(JointKind kind, Method method, double h) {
  Random random;
  WorldOptions chosen = weightless(h);
  chosen.method = method;
  chosen.tolerance = 1e-10;
  chosen.baumgarte = 0.2;
  chosen.iterations = 50;
  Joint joint = random_joint(kind, &random);
  joint.anchor_a *= 0.4;
  joint.anchor_b *= 0.4;
  PairPose pose = closed_pose(joint, &random);
  // a common rigid motion, plus a small one that the start projects onto the joint
  pose.b.linear_velocity =
      pose.a.linear_velocity + pose.a.angular_velocity.cross(pose.b.position - pose.a.position);
  pose.b.angular_velocity = pose.a.angular_velocity + 0.5 * random.vector();
  World world(chosen);
  Body a = make_body("a", Box{{0.3, 0.5, 0.9}}, 2.0, Vector3d::Zero());
  a.state = pose.a;
  Body b = make_body("b", Box{{0.8, 0.2, 0.4}}, 3.0, Vector3d::Zero());
  b.state = pose.b;
  joint.body_a = world.add_body(a);
  joint.body_b = world.add_body(b);
  world.add_joint(joint);
  return world;
}

/// A coupling in free space: a third box, and hinges or free distances between it and the first
/// two.
World free_triple(JointKind kind, Method method, double h) {
  Random random;
  const JointKind of = kind == JointKind::kPulley ? JointKind::kFreeDistance : JointKind::kHinge;
  World world = free_pair(of, method, h);
  const BodyId a = world.find_body("a");
  Joint second = random_joint(of, &random);
  second.name = "second";
  second.anchor_a *= 0.3;
  second.anchor_b *= 0.3;
  Body c = make_body("c", Box{{0.4, 0.6, 0.3}}, 1.5, Vector3d::Zero());
  c.no_collision = true;
  c.state = attached(second, world.state(a), &random);
  c.state.linear_velocity =
      world.state(a).linear_velocity +
      world.state(a).angular_velocity.cross(c.state.position - world.state(a).position);
  c.state.angular_velocity = world.state(a).angular_velocity;
  second.body_a = a;
  second.body_b = world.add_body(c);
  Joint coupling;
  coupling.name = "coupling";
  coupling.kind = kind;
  coupling.coupling.first = world.find_joint("joint");
  coupling.coupling.second = world.add_joint(second);
  coupling.coupling.ratio = -1.3;
  world.add_joint(coupling);
  return world;
}

World free_joint(JointKind kind, Method method, double h) {
  return info(kind).couples_joints ? free_triple(kind, method, h) : free_pair(kind, method, h);
}

class EachKind : public testing::TestWithParam<JointKind> {};

TEST_P(EachKind, KeepsRowsEnergyAndMomentaInFreeSpace) {
  for (const Method method : {Method::kRungeKutta, Method::kEnergyMomentum}) {
    World world = free_joint(GetParam(), method, 0.01);
    world.step();  // the start removes velocities that the joint forbids
    const double energy = world.energy();
    const Vector3d p = momentum(world), L = angular_momentum(world);
    for (int i = 0; i < 300; ++i) {
      const StepReport& report = world.step();
      ASSERT_FALSE(report.outcome.failed);
      // four roundings of coordinates of some metres
      ASSERT_LE(report.joints.max_error, 4e-15 + 4.0 * kEpsilon * 10.0) << name(method);
      ASSERT_EQ(report.costs.method_changes, 0u);
      ASSERT_EQ(report.joints.dependent_rows, 0u);
    }
    // tolerance of 1e-10 m in 300 ticks at a few m/s, and rounding
    EXPECT_NEAR(world.energy(), energy, 2e-8 * energy) << name(method);
    EXPECT_LE((momentum(world) - p).norm(), 1e-12 * p.norm()) << name(method);
    EXPECT_LE((angular_momentum(world) - L).norm(), 1e-8 * L.norm()) << name(method);
  }
}

// Order 8 against order 4, with an error of 1e-9 m in ticks of 1/1000 s, and against the first
// order of impulses, whose error halves with the tick.
TEST_P(EachKind, MovesAlikeByEachMethod) {
  const auto end = [&](Method method, double h) {
    World world = free_joint(GetParam(), method, h);
    const int steps = static_cast<int>(std::lround(0.5 / h));
    for (int i = 0; i < steps; ++i) world.step();
    std::vector<Vector3d> points;
    for (const char* body : {"a", "b"}) {
      const BodyState& state = world.state(world.find_body(body));
      for (int k = 0; k < 3; ++k)
        points.push_back(state.position + state.orientation * Vector3d::Unit(k));
    }
    return points;
  };
  const auto difference = [](const std::vector<Vector3d>& p, const std::vector<Vector3d>& q) {
    double most = 0.0;
    for (std::size_t i = 0; i < p.size(); ++i) most = std::max(most, (p[i] - q[i]).norm());
    return most;
  };
  const auto exact = end(Method::kRungeKutta, 0.01);
  EXPECT_LE(difference(end(Method::kEnergyMomentum, 0.001), exact), 1e-7);
  const double coarse = difference(end(Method::kSequentialImpulses, 0.002), exact);
  const double fine = difference(end(Method::kSequentialImpulses, 0.0005), exact);
  EXPECT_LE(coarse, 0.02);
  EXPECT_LE(fine, 0.4 * coarse + 1e-6);
}

TEST_P(EachKind, IsSavedAndLoadedAsItIs) {
  for (const Method method : {Method::kRungeKutta, Method::kSequentialImpulses}) {
    World world = free_joint(GetParam(), method, 0.01);
    for (int i = 0; i < 20; ++i) world.step();
    const std::string saved = save_scene(world);
    World loaded = load_scene(saved, "saved");
    EXPECT_EQ(save_scene(loaded), saved);
    for (int i = 0; i < 20; ++i) {
      world.step();
      loaded.step();
    }
    for (const BodyId id : world.body_ids())
      EXPECT_LE((world.state(id).position - loaded.state(id).position).norm(), 1e-8);
    if (method == Method::kSequentialImpulses) {
      EXPECT_EQ(world.state_hash(), loaded.state_hash());
    }
  }
}

INSTANTIATE_TEST_SUITE_P(JointKinds, EachKind, testing::ValuesIn(joint_kinds()),
                         [](const auto& kind) { return std::string(name(kind.param)); });

// ---- closed forms

Joint join_at(JointKind kind, BodyId a, const Vector3d& anchor_a, BodyId b,
              const Vector3d& anchor_b, const Vector3d& axis_a) {
  Joint joint =
      make_joint(std::string(name(kind)) + std::to_string(a.value) + "_" + std::to_string(b.value),
                 a, anchor_a, b, anchor_b, kind);
  joint.frame_a = frame_along(axis_a);
  return joint;
}

WorldOptions smooth(Method method, double h) {
  WorldOptions chosen = options(h);
  chosen.method = method;
  return chosen;
}

// A slider down an incline: x = ½ g sin α t² exactly.
TEST(Slider, FallsAlongItsAxisAsAParabola) {
  for (const Method method : {Method::kRungeKutta, Method::kEnergyMomentum}) {
    World world(smooth(method, 1.0 / 30.0));
    const double slope = 0.3;
    const Vector3d along(std::cos(slope), 0.0, -std::sin(slope));
    Body cart = make_body("cart", Box{{0.3, 0.2, 0.1}}, 2.0, {0.4, 0.3, 0.2});
    const BodyId id = world.add_body(cart);
    world.add_joint(
        join_at(JointKind::kSlider, kWorldBody, {0.4, 0.0, 0.2}, id, {0.0, -0.3, 0.0}, along));
    for (int i = 0; i < 60; ++i) world.step();
    const double t = world.time();
    const Vector3d expected =
        cart.state.position + 0.5 * kGravity * std::sin(slope) * t * t * along;
    // rounding of 6 m in 60 ticks
    EXPECT_LE((world.state(id).position - expected).norm(), 1e-12) << name(method);
    EXPECT_LE(world.state(id).orientation.vec().norm(), 1e-14) << name(method);
  }
}

// A bar on a hinge against θ̈ = −(m g l/I) sin θ, by the Runge-Kutta method of order 4 in steps of
// 1e-5 s, with an error below 1e-14.
TEST(Hinge, SwingsAsAPhysicalPendulum) {
  const double m = 2.0, length = 1.0, l = 0.5;
  const double I = m / 12.0 * (length * length + 0.01) + m * l * l;  // about y, box of 0.1 in z
  double theta = 1.2, rate = 0.0;
  const auto acceleration = [&](double angle) { return -m * kGravity * l / I * std::sin(angle); };
  constexpr int kSteps = 100000;
  const double h = 1.0 / kSteps;
  for (int i = 0; i < kSteps; ++i) {
    const double k1 = acceleration(theta), k2 = acceleration(theta + 0.5 * h * rate);
    const double k3 = acceleration(theta + 0.5 * h * rate + 0.25 * h * h * k1);
    const double k4 = acceleration(theta + h * rate + 0.5 * h * h * k2);
    theta += h * rate + h * h / 6.0 * (k1 + k2 + k3);
    rate += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
  }
  for (const auto& [method, tick, tolerance] :
       {std::tuple{Method::kRungeKutta, 1.0 / 30.0, 1e-7},
        std::tuple{Method::kEnergyMomentum, 1.0 / 1000.0, 1e-8}}) {
    World world(smooth(method, tick));
    Body bar = make_body("bar", Box{{length, 0.3, 0.1}}, m, Vector3d::Zero());
    const double start = 1.2;  // angle from the hanging pose, in which x of the bar points down
    const Quaterniond q(Eigen::AngleAxisd(0.5 * kPi - start, Vector3d::UnitY()));
    bar.state.orientation = q;
    bar.state.position = q * Vector3d(l, 0.0, 0.0);
    const BodyId id = world.add_body(bar);
    world.add_joint(join_at(JointKind::kHinge, kWorldBody, Vector3d::Zero(), id, {-l, 0.0, 0.0},
                            Vector3d::UnitY()));
    const int steps = static_cast<int>(std::lround(1.0 / tick));
    for (int i = 0; i < steps; ++i) world.step();
    const Vector3d expected(l * std::sin(theta), 0.0, -l * std::cos(theta));
    EXPECT_LE((world.state(id).position - expected).norm(), tolerance) << name(method);
    EXPECT_LE(std::abs(world.state(id).angular_velocity.y() + rate), 10.0 * tolerance);
  }
}

// Two boxes welded side by side rotate like the single body that they form.
TEST(Weld, MakesOneBodyOfTwo) {
  const Vector3d size(0.3, 0.5, 0.2), spin(2.0, 0.3, -1.0);
  const double m = 1.5;
  const Vector3d each =
      m / 12.0 *
      Vector3d(size.y() * size.y() + size.z() * size.z(), size.z() * size.z() + size.x() * size.x(),
               size.x() * size.x() + size.y() * size.y());
  const double off = 0.5 * size.x();
  const auto run = [&](World world) {
    for (int i = 0; i < 60; ++i) world.step();
    return world;
  };
  World single(smooth(Method::kRungeKutta, 1.0 / 30.0));
  Body body = make_body("whole", Point{}, 2.0 * m, Vector3d::Zero());
  body.inertia = 2.0 * (each + m * off * off * Vector3d(0.0, 1.0, 1.0));
  body.state.angular_velocity = spin;
  single.add_body(body);
  const BodyState whole = run(single).state(single.find_body("whole"));
  for (const auto& [method, tick, tolerance] :
       {std::tuple{Method::kRungeKutta, 1.0 / 30.0, 3e-7},
        std::tuple{Method::kEnergyMomentum, 1.0 / 30.0, 3e-6}}) {
    World world(smooth(method, tick));
    std::vector<BodyId> ids;
    for (const double side : {-1.0, 1.0}) {
      Body half = make_body(side < 0.0 ? "left" : "right", Box{size}, m, {side * off, 0.0, 0.0});
      half.state.angular_velocity = spin;
      half.state.linear_velocity = spin.cross(half.state.position);
      half.no_collision = true;
      ids.push_back(world.add_body(half));
    }
    world.add_joint(join_at(JointKind::kWeld, ids[0], {off, 0.0, 0.0}, ids[1], {-off, 0.0, 0.0},
                            {0.3, -0.2, 0.5}));
    world = run(world);
    for (std::size_t k = 0; k < 2; ++k) {
      const Vector3d there =
          whole.position + whole.orientation * Vector3d(k == 0 ? -off : off, 0, 0);
      EXPECT_LE((world.state(ids[k]).position - there).norm(), tolerance) << name(method);
      EXPECT_LE(world.state(ids[k]).orientation.angularDistance(whole.orientation), tolerance)
          << name(method);
    }
  }
}

// A shaft driven at ω₁ turns a second one, at an angle β, by a universal joint: ω₂ = ω₁ cos β / (1
// − sin²β sin²θ), with θ = 0 where the first cross axis is normal to both shafts.
TEST(Universal, TurnsAShaftUnevenly) {
  const double beta = 40.0 * kPi / 180.0, speed = 3.0;
  World world(smooth(Method::kRungeKutta, 1.0 / 60.0));
  Body first = make_body("first", Box{{0.4, 0.1, 0.1}}, 1.0, Vector3d::Zero());
  first.type = BodyType::kKinematic;
  first.state.angular_velocity = {speed, 0.0, 0.0};
  const BodyId driving = world.add_body(first);
  const Vector3d axis(std::cos(beta), std::sin(beta), 0.0);
  Body second =
      make_body("second", Box{{0.4, 0.1, 0.1}}, 1.0, Vector3d(0.2, 0.0, 0.0) + 0.2 * axis);
  second.state.orientation = Eigen::AngleAxisd(beta, Vector3d::UnitZ());
  const BodyId driven = world.add_body(second);
  // the cross is on z of the first shaft, and on the first shaft's y in the second
  Joint cross = join_at(JointKind::kUniversal, driving, {0.2, 0.0, 0.0}, driven, {-0.2, 0.0, 0.0},
                        Vector3d::UnitZ());
  EXPECT_NE(refusal([&] { world.add_joint(cross); }).find("axis_b: "), std::string::npos);
  cross.axis_b = Vector3d::UnitY();
  world.add_joint(cross);
  // the second shaft rotates in a bearing that leaves it free along its axis
  world.add_joint(join_at(JointKind::kCylindrical, kWorldBody, second.state.position, driven,
                          Vector3d::Zero(), axis));
  for (int i = 0; i < 120; ++i) {
    ASSERT_LE(world.step().joints.max_error, 1e-12);
    const double theta = speed * world.time();
    const double sine = std::sin(beta) * std::sin(theta);
    const double expected = speed * std::cos(beta) / (1.0 - sine * sine);
    EXPECT_NEAR(world.state(driven).angular_velocity.dot(axis), expected, 1e-9) << theta;
  }
}

// ---- redundant mechanisms

void expect_kept(World world, double seconds, std::uint32_t dependent, double energy_tolerance) {
  world.step();
  const double energy = world.energy();
  double largest = 0.0;
  const int steps = static_cast<int>(std::lround(seconds / world.options().time_step));
  for (int i = 0; i < steps; ++i) {
    const StepReport& report = world.step();
    ASSERT_FALSE(report.outcome.failed);
    ASSERT_EQ(report.joints.dependent_rows, dependent) << i;
    ASSERT_EQ(report.costs.method_changes, 0u) << i;
    largest = std::max(largest, report.joints.max_error);
  }
  EXPECT_LE(largest, 1e-12);
  EXPECT_NEAR(world.energy(), energy, energy_tolerance);
}

/// Three bars and the ground on four parallel hinges: planar, so three rows are redundant.
World four_bar(Method method, double h) {
  World world(smooth(method, h));
  const std::vector<Vector3d> pins{{0, 0, 0}, {0.3, 0, 1.0}, {1.8, 0, 1.3}, {2.0, 0, 0}};
  std::vector<BodyId> bars;
  for (std::size_t k = 0; k < 3; ++k) {
    const Vector3d along = pins[k + 1] - pins[k];
    Body bar = make_body("bar" + std::to_string(k), Box{{along.norm(), 0.1, 0.1}},
                         1.0 + 0.2 * static_cast<double>(k), 0.5 * (pins[k] + pins[k + 1]));
    bar.state.orientation = rotation_between(Vector3d::UnitX(), along);
    bar.no_collision = true;
    bars.push_back(world.add_body(bar));
  }
  const auto in_body = [&](std::size_t k, const Vector3d& p) -> Vector3d {
    const BodyState& state = world.state(bars[k]);
    return state.orientation.conjugate() * (p - state.position);
  };
  const auto axis_in = [&](std::size_t k) -> Vector3d {
    return world.state(bars[k]).orientation.conjugate() * Vector3d::UnitY();
  };
  world.add_joint(join_at(JointKind::kHinge, kWorldBody, pins[0], bars[0], in_body(0, pins[0]),
                          Vector3d::UnitY()));
  for (std::size_t k = 0; k < 2; ++k)
    world.add_joint(join_at(JointKind::kHinge, bars[k], in_body(k, pins[k + 1]), bars[k + 1],
                            in_body(k + 1, pins[k + 1]), axis_in(k)));
  world.add_joint(join_at(JointKind::kHinge, kWorldBody, pins[3], bars[2], in_body(2, pins[3]),
                          Vector3d::UnitY()));
  return world;
}

// Bound: ten ticks of tolerance of 1e-8 m at 10 N are 1e-6 J.
TEST(Redundant, AFourBarOfHingesKeepsJointsAndEnergy) {
  expect_kept(four_bar(Method::kRungeKutta, 1.0 / 60.0), 3.0, 3, 1e-6);
  expect_kept(four_bar(Method::kEnergyMomentum, 1.0 / 60.0), 3.0, 3, 1e-9);
  expect_kept(four_bar(Method::kAuto, 1.0 / 1000.0), 1.0, 3, 1e-6);
}

// A door on two hinges: the second one is redundant.
TEST(Redundant, ADoorOnTwoHingesHasFiveRowsTooMany) {
  for (const Method method : {Method::kRungeKutta, Method::kEnergyMomentum}) {
    World world(smooth(method, 0.01));
    Body door = make_body("door", Box{{1.0, 0.05, 2.0}}, 10.0, {0.5, 0.0, 0.0});
    door.state.angular_velocity = {0.0, 0.0, 2.0};
    door.state.linear_velocity = {0.0, 1.0, 0.0};
    const BodyId id = world.add_body(door);
    for (const double z : {-0.8, 0.8}) {
      Joint hinge = join_at(JointKind::kHinge, kWorldBody, {0.0, 0.0, z}, id, {-0.5, 0.0, z},
                            Vector3d::UnitZ());
      hinge.name += z < 0.0 ? "_low" : "_high";
      world.add_joint(hinge);
    }
    expect_kept(world, 3.0, 5, 1e-10 * 100.0);
  }
}

// ---- refusals

TEST(JointFrames, NeedBodiesThatHaveAxes) {
  World world(smooth(Method::kAuto, 0.01));
  const BodyId point = world.add_body(make_body("dust", Point{}, 1.0, Vector3d::Zero()));
  const BodyId box = world.add_body(make_body("box", Box{{0.1, 0.1, 0.1}}, 1.0, {0.0, 0.0, 1.0}));
  const auto add = [&](JointKind kind, BodyId a, BodyId b) {
    Joint joint = join_at(kind, a, Vector3d::Zero(), b, Vector3d::Zero(), Vector3d::UnitX());
    joint.name = "joint_" + std::to_string(world.joint_ids().size());
    world.add_joint(joint);
  };
  EXPECT_EQ(refusal([&] { add(JointKind::kWeld, box, point); }),
            "body_b: 'dust' is a point mass without inertia and has no axes, which a joint of "
            "type weld needs");
  EXPECT_NE(refusal([&] { add(JointKind::kPointOnLine, point, box); }).find("body_a: 'dust'"),
            std::string::npos);
  add(JointKind::kPointOnLine, box, point);
  add(JointKind::kPointOnPlane, kWorldBody, point);
}

// An axis of any length gives the same frame, also where its square underflows.
TEST(JointFrames, AxesHaveAnyLength) {
  const Vector3d axis = Vector3d(0.6, 0.0, -0.8);
  for (const double size : {1.0, 1e-160, 1e-200, 1e-300, 1e20}) {
    EXPECT_LE((frame_along(size * axis) * Vector3d::UnitZ() - axis).norm(), 1e-15) << size;
    World world(smooth(Method::kAuto, 0.01));
    const BodyId id = world.add_body(make_body("arm", Box{{1, 1, 1}}, 1.0, Vector3d::Zero()));
    Joint hinge =
        join_at(JointKind::kHinge, kWorldBody, Vector3d::Zero(), id, Vector3d::Zero(), size * axis);
    hinge.axis_b = size * axis;
    const Joint& added = world.joint(world.add_joint(hinge));
    EXPECT_LE((*added.frame_b * Vector3d::UnitZ() - axis).norm(), 1e-15) << size;
  }
  EXPECT_EQ(refusal([] { frame_along(Vector3d::Zero()); }), "axis_a: must not be (0, 0, 0)");
  EXPECT_EQ(refusal([] { frame_along(Vector3d(0.0, kInfinity, 0.0)); }),
            "axis_a: must be finite numbers, got (0, inf, 0)");
}

// Frames are normalized once; saving and loading keeps them to the bit.
TEST(JointFrames, AreSavedAndLoadedToTheBit) {
  Random random;
  for (int trial = 0; trial < 40; ++trial) {
    World world(smooth(Method::kAuto, 0.01));
    Body body = make_body("box", Box{{1, 1, 1}}, 1.0, random.vector());
    body.state.orientation = random.orientation();
    const BodyId id = world.add_body(body);
    Joint weld = join_at(JointKind::kWeld, kWorldBody, body.state.position, id, Vector3d::Zero(),
                         Vector3d::UnitZ());
    weld.frame_a = random.orientation();  // frame B follows from the rest
    world.add_joint(weld);
    const std::string saved = save_scene(world);
    World loaded = load_scene(saved, "saved");
    ASSERT_EQ(save_scene(loaded), saved) << trial;
    ASSERT_EQ(loaded.state_hash(), world.state_hash()) << trial;
  }
}

/// A weld or hinge of two boxes of this size [m] that one sweep without Baumgarte cannot hold
/// against a torque: impulses leave an angle error above `angle` [rad].
World forced_apart(JointKind kind, double size, double angle) {
  WorldOptions chosen = weightless(0.01);
  chosen.baumgarte = 0.0;
  chosen.iterations = 1;
  chosen.warm_starting = false;
  World world(chosen);
  Body a = make_body("a", Box{size * Vector3d(0.3, 0.2, 0.1)}, 1.0, Vector3d::Zero());
  Body b = make_body("b", Box{size * Vector3d(0.1, 0.2, 0.3)}, 1.0, size * Vector3d(0.4, 0.0, 0.0));
  a.no_collision = b.no_collision = true;
  const BodyId id_a = world.add_body(a), id_b = world.add_body(b);
  const JointId joint =
      world.add_joint(join_at(kind, id_a, size * Vector3d(0.2, 0.0, 0.0), id_b,
                              size * Vector3d(-0.2, 0.0, 0.0), Vector3d::UnitZ()));
  Wrench twist;
  twist.body = id_b;
  twist.torque = size * size * Vector3d(0.0, 40.0, 3.0);
  world.add_wrench(twist);
  for (int i = 0; i < 3000 && world.joint_state(joint).angle_error <= angle; ++i) world.step();
  EXPECT_GT(world.joint_state(joint).angle_error, angle);
  world.clear_wrenches(id_b);
  return world;
}

// A world can be saved and loaded however far off its joints are.
TEST(JointFrames, LeftOpenByImpulsesAreSavedAndSetAsTheyAre) {
  World world = forced_apart(JointKind::kHinge, 1.0, 0.6);
  const std::string saved = save_scene(world);
  World loaded = load_scene(saved, "saved");
  EXPECT_EQ(save_scene(loaded), saved);
  const BodyId b = world.find_body("b");
  for (World* each : {&world, &loaded}) {
    BodyState stopped = each->state(b);
    stopped.linear_velocity.setZero();
    each->set_state(b, stopped);
    each->step();
  }
  EXPECT_EQ(world.state_hash(), loaded.state_hash());
}

// Open joints are reported, also where the angle error is less than a millimetre on very small
// bodies.
TEST(JointFrames, LeftOpenInAngleAreToldAtAnySize) {
  for (const double size : {1.0, 1e-3}) {
    World world = forced_apart(JointKind::kHinge, size, 2.2);
    const JointId joint = world.joint_ids().front();
    const BodyId b = world.find_body("b");
    for (int i = 0; i < 100; ++i) {
      BodyState held = world.state(b);
      held.linear_velocity.setZero();
      held.angular_velocity.setZero();
      world.step();
      EXPECT_GT(world.joint_state(joint).angle_error, 0.5);
    }
    EXPECT_EQ(world.report().joints.unclosed, 1u) << size;
    ASSERT_TRUE(world.report().joints.worst_unclosed) << size;
    EXPECT_EQ(*world.report().joints.worst_unclosed, joint) << size;
  }
}

// Rows have several solutions; from any orientation the intended one is found.
TEST(JointFrames, LeftOpenByImpulsesCloseToTheSolutionThatIsMeant) {
  for (const double size : {1.0, 1e-3}) {
    World world = forced_apart(JointKind::kHinge, size, 2.2);
    const BodyId b = world.find_body("b");
    BodyState stopped = world.state(b);
    stopped.linear_velocity.setZero();
    stopped.angular_velocity.setZero();
    world.set_state(b, stopped);
    WorldOptions chosen = world.options();
    chosen.method = Method::kRungeKutta;
    chosen.tolerance *= size;
    world.set_options(chosen);
    for (int i = 0; i < 100; ++i) world.step();
    const JointState& state = world.joint_state(world.joint_ids().front());
    EXPECT_LE(state.angle_error, 1e-12) << size;
    EXPECT_FALSE(state.closing) << size;
    EXPECT_EQ(world.report().joints.unclosed, 0u) << size;
  }
}

// A hinge added after its body had rotated is open after a reset, and closes.
TEST(JointFrames, AResetClosesWhatItLeavesOpen) {
  for (const Method method : {Method::kRungeKutta, Method::kEnergyMomentum}) {
    World world(smooth(method, 0.01));
    const BodyId id = world.add_body(make_body("bar", Box{{1.0, 0.1, 0.2}}, 1.0, {0.5, 0.0, 0.0}));
    BodyState turned = world.state(id);
    turned.orientation = Eigen::AngleAxisd(0.4, Vector3d::UnitX());
    world.set_state(id, turned);
    const JointId hinge = world.add_joint(join_at(JointKind::kHinge, kWorldBody, Vector3d::Zero(),
                                                  id, {-0.5, 0.0, 0.0}, Vector3d::UnitY()));
    world.reset();
    EXPECT_NEAR(world.joint_state(hinge).angle_error, 0.4, 1e-12);
    for (int i = 0; i < 100; ++i) ASSERT_FALSE(world.step().outcome.failed);
    EXPECT_FALSE(world.joint_state(hinge).closing);
    EXPECT_LE(world.joint_state(hinge).angle_error, 1e-12) << name(method);
  }
}

// A ball joint and parallel axes form a hinge: the hinge's rows, or those of one more joint, to
// rounding.
TEST(Parallel, IsAHingeWithABallJoint) {
  for (const Method method : {Method::kRungeKutta, Method::kEnergyMomentum}) {
    std::array<World, 2> worlds{World(smooth(method, 0.01)), World(smooth(method, 0.01))};
    for (std::size_t w = 0; w < 2; ++w) {
      Body door = make_body("door", Box{{0.8, 0.1, 1.9}}, 3.0, {0.4, 0.0, 0.0});
      door.state.angular_velocity = Vector3d(0.0, 1.0, 2.0).normalized() * 1.5;
      const Vector3d axis(0.0, 1.0, 2.0), at_door(-0.4, 0.0, 0.3);
      const BodyId id = worlds[w].add_body(door);
      const auto join = [&](JointKind kind) {
        worlds[w].add_joint(join_at(kind, kWorldBody, {0.0, 0.0, 0.3}, id, at_door, axis));
      };
      if (w == 0) {
        join(JointKind::kHinge);
      } else {
        join(JointKind::kBall);
        join(JointKind::kParallel);
      }
      for (int i = 0; i < 200; ++i) worlds[w].step();
    }
    const BodyState& one = worlds[0].state(worlds[0].body_ids()[0]);
    const BodyState& other = worlds[1].state(worlds[1].body_ids()[0]);
    EXPECT_LE((one.position - other.position).norm(), 1e-12) << name(method);
    EXPECT_LE(one.orientation.angularDistance(other.orientation), 1e-11) << name(method);
  }
}

// A point mass on a plane through the origin slides without rotation.
TEST(PointOnPlane, SlidesWithoutTurning) {
  World world(smooth(Method::kRungeKutta, 0.01));
  const double slope = 0.4;
  Body body = make_body("dust", Point{}, 1.0, Vector3d::Zero());
  body.state.linear_velocity = {0.0, 2.0, 0.0};
  const BodyId id = world.add_body(body);
  const Vector3d normal(std::sin(slope), 0.0, std::cos(slope));
  world.add_joint(join_at(JointKind::kPointOnPlane, kWorldBody, Vector3d::Zero(), id,
                          Vector3d::Zero(), normal));
  for (int i = 0; i < 100; ++i) world.step();
  const double t = world.time(), s = 0.5 * kGravity * std::sin(slope) * t * t;
  const Vector3d expected(s * std::cos(slope), 2.0 * t, -s * std::sin(slope));
  EXPECT_LE((world.state(id).position - expected).norm(), 1e-12);
}

}  // namespace
}  // namespace constraint_sim::engine
