// Stiff islands: the discrete-gradient midpoint rule against references in minimal coordinates,
// conserved quantities and finite differences; when `auto` chooses it, and its limits.

#include <algorithm>
#include <array>
#include <numeric>
#include <optional>

#include "counted_allocations.h"
#include "engine/dynamics/implicit/implicit_step.h"
#include "engine/islands/island_motion.h"
#include "engine/math/list.h"
#include "problems.h"
#include "random_joints.h"
#include "redundant_scenes.h"
#include "sanitized.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using problems::largest_distance;

/// Takes one step a tick, even for fast rotations.
World unrefined(World world) {
  WorldOptions options = world.options();
  options.tolerance = 0.0;
  world.set_options(options);
  return world;
}

World with_method(World world, double time_step, Method method = Method::kAuto,
                  int stiff_order = 4) {
  WorldOptions options = world.options();
  options.time_step = time_step;
  options.method = method;
  options.stiff_order = stiff_order;
  world.set_options(options);
  return world;
}

/// Figures of a run of stiff islands.
struct Record {
  double drift = 0.0;       // largest drift of energy over the largest kinetic energy
  double iterations = 0.0;  // Newton iterations, mean of all midpoint steps
  double first = 0.0;       // Newton iterations of the first tick
  std::uint32_t changes = 0;
  std::uint32_t stiff_steps = 0;  // ticks advanced by discrete gradients
};

/// Runs, and expects every rod exact to rounding in every tick, without impulses.
Record run_and_record(World& world, double duration) {
  Record record;
  double iterations = 0.0, steps = 0.0;
  const auto ticks = std::lround(duration / world.options().time_step);
  for (long i = 0; i < ticks; ++i) {
    const StepReport& report = world.step();
    const bool is_exact = !report.outcome.failed &&
                          report.costs.islands[index_of(Method::kSequentialImpulses)] == 0 &&
                          report.joints.max_error <= round_off(world);
    if (!is_exact) {
      ADD_FAILURE() << "at t = " << world.time() << ": " << to_string(world.islands().front().why)
                    << ", joints off by " << report.joints.max_error;
      return record;
    }
    record.drift = std::max(record.drift, std::abs(report.energy.drift));
    record.changes += report.costs.method_changes;
    if (report.costs.islands[index_of(Method::kEnergyMomentum)] == 0) continue;
    ++record.stiff_steps;
    iterations += report.costs.iterations;
    steps += report.costs.substeps;
    if (i == 0) record.first = iterations / steps;
  }
  record.iterations = steps > 0.0 ? iterations / steps : 0.0;
  return record;
}

// ---- the equations of one step

/// A tree of boxes and points on rods, ball joints and springs, in a random pose; with `is_closed`
/// also a loop.
struct Assembly {
  List<BodyState> states;
  List<MassProperties> masses;
  List<Joint> joints;
  List<std::pair<std::size_t, std::size_t>> ends;

  explicit Assembly(bool is_closed) {
    Random random;
    for (int i = 0; i < 5; ++i) {
      states.push_back(random.state());
      MassProperties mass;
      if (i > 0) {
        mass.inverse_mass = 1.0 / (0.5 + i);
        if (i < 4) mass.inertia = {0.1 * i, 0.15 * i, 0.2};
        if (i < 4) mass.inverse_inertia = mass.inertia.cwiseInverse();
      }
      masses.push_back(mass);
    }
    const auto add = [&](std::size_t a, std::size_t b, const JointType& type, bool is_off_centre) {
      Joint joint;
      type.write(&joint);
      if (is_off_centre) joint.anchor_a = 0.3 * random.vector();
      if (is_off_centre) joint.anchor_b = 0.3 * random.vector();
      joints.push_back(joint);
      ends.emplace_back(a, b);
    };
    add(0, 1, JointKind::kBall, true);
    add(1, 2, rod(1.0), true);
    add(2, 3, spring(1.2, 50.0, 2.0), true);
    add(3, 4, rod(0.8), false);
    add(0, 4, spring(0.5, 80.0, 0.0), false);
    if (!is_closed) return;
    add(1, 4, rod(0.9), true);
    add(3, 1, JointKind::kBall, true);
  }

  EquationsOfMotion equations() const {
    List<int> all(joints.size());
    std::iota(all.begin(), all.end(), 0);
    return EquationsOfMotion(all, joints, ends, masses);
  }
};

// The derivative D satisfies D⁻¹ (r(u + εe) − r(u − εe))/2ε = e for every unknown. The difference
// has errors of ε² and rounding over ε, together 1e-9 at ε = 1e-5, and D⁻¹ amplifies it up to 1e3
// times.
TEST(ImplicitStep, DerivativeAgreesWithFiniteDifferences) {
  struct Case {
    bool is_closed;
    ImplicitRule rule;
  };
  for (const auto& [is_closed, rule] :
       {Case{false, ImplicitRule::kMidpoint}, Case{true, ImplicitRule::kMidpoint},
        Case{false, ImplicitRule::kBdf2}, Case{true, ImplicitRule::kBdf2}}) {
    const Assembly assembly(is_closed);
    EquationsOfMotion equations = assembly.equations();
    List<PrescribedMotion> prescribed(assembly.joints.size());
    for (std::size_t j = 0; j < prescribed.size(); ++j) {
      JointData state;
      prescribed[j] = PrescribedMotion(assembly.joints[j], {0.0, 0.1, 0.1, 0.5}, state);
    }
    const List<AppliedWrench> loads{{1, {1.0, 2.0, 3.0}, {0.5, -0.3, 0.2}}};
    equations.begin(0.0, assembly.states, {0.0, 0.0, -kGravity}, loads, prescribed);
    ImplicitStep step(equations);
    step.gather_state(assembly.states, equations);
    step.begin(0.0, 0.1, ImplicitRule::kMidpoint, &equations);
    if (rule != ImplicitRule::kMidpoint) {  // after a previous step, with any solution
      step.finish(ImplicitStep::Unknowns(step.size(), 0.01), &equations);
      step.begin(0.1, 0.1, rule, &equations);
    }

    Random random;
    ImplicitStep::Unknowns unknowns(step.size());
    for (double& unknown : unknowns) unknown = 0.3 * random();
    const double epsilon = 1e-5;
    for (std::size_t e = 0; e < unknowns.size(); ++e) {
      List<double> difference(unknowns.size());
      for (const double sign : {-1.0, 1.0}) {
        ImplicitStep::Unknowns moved = unknowns;
        List<double> change(unknowns.size(), 0.0);
        change[e] = sign * epsilon;
        step.add(change.data(), &moved);
        step.evaluate(moved);
        for (std::size_t i = 0; i < difference.size(); ++i)
          difference[i] += sign * step.system().residual()[i] / (2.0 * epsilon);
      }
      step.evaluate(unknowns);
      ASSERT_TRUE(step.system().solve(difference.data()));
      for (std::size_t i = 0; i < difference.size(); ++i)
        EXPECT_NEAR(difference[i], i == e ? 1.0 : 0.0, 1e-6) << i << " by " << e;
    }
  }
}

double measured_order(int stiff_order, const List<int>& rates) {
  const auto reference = problems::chain_reference(2, 1.0);
  List<double> steps, errors;
  for (const int rate : rates) {
    World world = with_method(problems::chain(2), 1.0 / rate, Method::kEnergyMomentum, stiff_order);
    run_and_record(world, 1.0);
    steps.push_back(1.0 / rate);
    errors.push_back(largest_distance(world, reference));
  }
  return order(steps, errors);
}

TEST(EnergyMomentum, HasOrder2AndOrder4) {
  EXPECT_NEAR(measured_order(2, {100, 200, 400}), 2.0, 0.1);
  EXPECT_NEAR(measured_order(4, {60, 120, 240}), 4.0, 0.2);
}

/// Weightless, free boxes on ball joints and a rod, rotating.
World linked_boxes() {
  WorldOptions options;
  options.gravity = Vector3d::Zero();
  World world(options);
  std::vector<BodyId> boxes;
  for (int i = 0; i < 3; ++i) {
    Body body =
        make_body("box_" + std::to_string(i), Box{{0.2, 0.3, 0.6}}, 1.0 + i, {0.8 * i, 0.0, 0.0});
    body.state.angular_velocity = {0.3 * i, 1.0 - i, 0.4};
    body.no_collision = true;
    boxes.push_back(world.add_body(body));
  }
  world.add_joint(
      make_joint("ball", boxes[0], {0.4, 0.0, 0.1}, boxes[1], {-0.4, 0.0, 0.1}, JointKind::kBall));
  world.add_joint(make_joint("rod", boxes[1], {0.1, 0.15, 0.0}, boxes[2], {-0.1, 0.15, 0.0}));
  return world;
}

TEST(EnergyMomentum, KeepsEnergyAndMomentumOfLinkedBoxes) {
  World world = unrefined(with_method(linked_boxes(), 0.05, Method::kEnergyMomentum, 2));
  world.step();  // the joints' projection of initial velocities
  const Vector3d p = momentum(world), L = angular_momentum(world);
  const double energy = world.energy();
  const Record record = run_and_record(world, 50.0);
  EXPECT_EQ(record.stiff_steps, 1000u);
  // a random walk of rounding over 1000 steps
  EXPECT_LE((momentum(world) - p).norm(), 1e-12 * p.norm() + 1e-12);
  EXPECT_LE((angular_momentum(world) - L).norm(), 1e-11 * L.norm());
  EXPECT_NEAR(world.energy(), energy, 1e-11 * energy);
}

/// Returns the reference by substeps of order 8, far more accurate than the compared results.
World boxes_after_a_second() {
  World world = linked_boxes();
  WorldOptions options = world.options();
  options.time_step = 0.1;
  options.tolerance = 1e-12;
  world.set_options(options);
  run(world, 10);
  return world;
}

TEST(EnergyMomentum, TurnsBodiesInItsOrder) {
  const World exact = boxes_after_a_second();
  for (const int stiff_order : {2, 4}) {
    List<double> steps, errors;
    for (const int rate : {40, 80, 160}) {
      World world =
          unrefined(with_method(linked_boxes(), 1.0 / rate, Method::kEnergyMomentum, stiff_order));
      run_and_record(world, 1.0);
      steps.push_back(1.0 / rate);
      errors.push_back(problems::largest_difference(world, exact));
    }
    EXPECT_NEAR(order(steps, errors), stiff_order, 0.3) << stiff_order;
  }
}

// ---- BDF2

World dissipating(World world, double time_step) {
  WorldOptions options = world.options();
  options.time_step = time_step;
  options.method = Method::kEnergyMomentum;
  options.dissipation = true;
  world.set_options(options);
  return world;
}

TEST(EnergyMomentum, HasOrder2WithDissipation) {
  const auto reference = problems::chain_reference(2, 1.0);
  const World exact = boxes_after_a_second();
  List<double> steps, of_chain, of_boxes;
  for (const int rate : {200, 400, 800}) {
    World chain = dissipating(problems::chain(2), 1.0 / rate);
    World boxes = unrefined(dissipating(linked_boxes(), 1.0 / rate));
    run_and_record(chain, 1.0);
    run_and_record(boxes, 1.0);
    steps.push_back(1.0 / rate);
    of_chain.push_back(largest_distance(chain, reference));
    of_boxes.push_back(problems::largest_difference(boxes, exact));
  }
  EXPECT_NEAR(order(steps, of_chain), 2.0, 0.2);
  EXPECT_NEAR(order(steps, of_boxes), 2.0, 0.2);
}

// A spring of 1e6 N/m, stretched by 1 mm, at h ω = 100: BDF2 halves this motion in every step.
TEST(EnergyMomentum, DissipationTakesOutWhatIsTooFastToBeShown) {
  for (const bool dissipation : {false, true}) {
    World world = with_method(World(), 0.1);
    Body body = make_body("bob", Point{}, 1.0, {0.0, 0.0, -1.001});
    body.state.linear_velocity = {0.1, 0.0, 0.0};
    const BodyId bob = world.add_body(body);
    const JointId line = world.add_joint(hang("line", bob, spring(1.0, 1e6, 0.0)));
    WorldOptions options = world.options();
    options.dissipation = dissipation;
    world.set_options(options);
    double energy = world.energy();
    const double at_first = energy;
    for (int i = 0; i < 100; ++i) {
      ASSERT_FALSE(world.step().outcome.failed);
      EXPECT_TRUE(!dissipation || i < 2 || world.energy() <= energy + 1e-9) << i;
      energy = world.energy();
    }
    ASSERT_EQ(world.islands().front().method, Method::kEnergyMomentum);
    const double left =
        world.joint_state(line).error - kGravity / 1e6;  // beside the weight's extension
    if (dissipation) {
      EXPECT_LE(std::abs(left), 1e-6);
    } else {
      EXPECT_NEAR(energy, at_first, 1e-9);
    }
  }
}

// ---- the heavy chain

class HeavyChain : public ::testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(EndMass, HeavyChain, ::testing::Values(1.0, 1e2, 1e3, 1e4, 1e6, 1e8, 1e9));

// Rounding of a potential energy of m g 11 m is 1e-14 of the kinetic energy of m (1 m/s)²/2 per
// step; the bound allows a random walk of 1e4 steps.
TEST_P(HeavyChain, KeepsEnergyAndRods) {
  for (const int rate : {30, 100, 240, 1000}) {
    World world = with_method(problems::heavy_chain(GetParam(), true), 1.0 / rate);
    const Record record = run_and_record(world, 3.0);
    EXPECT_LE(record.drift, 1e-10) << rate;
    EXPECT_LE(record.iterations, 6.0) << rate;
    EXPECT_LE(record.first, 10.0) << rate;
    const bool is_stiff = std::sqrt(4.0 * GetParam() * kGravity / 0.1) / rate > 60.0;
    EXPECT_TRUE(!is_stiff || record.stiff_steps > 0) << rate;
  }
}

TEST(EnergyMomentum, AChainInLineEndsWhereItShouldAtLongTicks) {
  for (const double mass : {1.0, 1e2, 1e3, 1e4}) {
    World world = with_method(problems::heavy_chain(mass, true), 1.0 / 30.0);
    run_and_record(world, 0.5);
    const auto reference = problems::heavy_chain_reference(mass, true, 0.5);
    EXPECT_LE((world.state(world.body_ids().back()).position - reference.back()).norm(), 1e-6)
        << mass;
  }
}

TEST(EnergyMomentum, AHeavyLoadSwingsAsOnARigidRod) {
  // links of 0.1 kg change the position of 1e6 kg by 1e-7 relative
  const auto reference = problems::integrate(
      [](const problems::Reals& y) {
        return problems::Reals{y[1], -static_cast<problems::Real>(kGravity) / 11 * std::sin(y[0])};
      },
      {problems::Real{0}, problems::Real{1} / 11}, problems::Real{5}, 100);
  const double angle = static_cast<double>(reference[0]);
  const Vector3d end = 11.0 * Vector3d(std::sin(angle), 0.0, -std::cos(angle));
  for (const double mass : {1e6, 1e7, 1e8, 1e9}) {
    World world = with_method(problems::heavy_chain(mass, true), 1.0 / 30.0);
    run_and_record(world, 5.0);
    EXPECT_LE((world.state(world.body_ids().back()).position - end).norm(), 1e-6) << mass;
  }
}

// Only the load moves initially: the tick resolves the load's motion, but not that of the links.
TEST(EnergyMomentum, FollowsTheLoadWhereLinksAreNotResolved) {
  struct Case {
    double mass, duration;
  };
  for (const auto& [mass, duration] : {Case{1e3, 1.0}, Case{1e4, 0.5}, Case{1e6, 0.2}}) {
    const auto reference = problems::heavy_chain_reference(mass, false, duration);
    World world = with_method(problems::heavy_chain(mass, false), 1.0 / 30.0);
    run_and_record(world, duration);
    EXPECT_LE((world.state(world.body_ids().back()).position - reference.back()).norm(), 1e-5)
        << mass;
  }
}

TEST(EnergyMomentum, StaysBoundedForAnHour) {
  World world = with_method(problems::heavy_chain(1e6, false), 1.0 / 30.0, Method::kAuto, 2);
  const Record record = run_and_record(world, 3600.0 / kSanitizedShare);
  EXPECT_LE(record.drift, 1e-9);
  EXPECT_EQ(record.stiff_steps, 108000u / kSanitizedShare);
  // the links are in line except for a small motion; 1 m/s lifts the load by v²/2g
  const Vector3d end = world.state(world.body_ids().back()).position;
  EXPECT_NEAR(end.norm(), 11.0, 1e-6);
  EXPECT_LE(end.z() + 11.0, 0.5 / kGravity + 1e-6);
}

/// Ten slender rods on ball joints, and a heavy box below.
World heavy_box(double mass) {
  World world;
  BodyId last = kWorldBody;
  double top = 0.0, half = 0.0;
  for (int i = 0; i <= 10; ++i) {
    const bool is_load = i == 10;
    const double length = is_load ? 2.0 : 1.0;
    Body body = make_body("link_" + std::to_string(i),
                          is_load ? Box{{1.0, 1.5, 2.0}} : Box{{0.02, 0.02, 1.0}},
                          is_load ? mass : 0.1, {0.0, 0.0, top - 0.5 * length});
    body.no_collision = true;
    const double omega = 1.0 / 11.0;  // all rotate about the origin together
    body.state.angular_velocity = {0.0, -omega, 0.0};
    body.state.linear_velocity = {omega * -body.state.position.z(), 0.0, 0.0};
    const BodyId id = world.add_body(body);
    world.add_joint(make_joint("ball_" + std::to_string(i), last, {0.0, 0.0, -half}, id,
                               {0.0, 0.0, 0.5 * length}, JointKind::kBall));
    half = 0.5 * length;
    top -= length;
    last = id;
  }
  return world;
}

TEST(EnergyMomentum, CarriesAHeavyBoxOnLightRods) {
  for (const double mass : {1.0, 1e3, 1e5, 1e7, 1e9}) {
    for (const int rate : {30, 240, 1000}) {
      World world = with_method(heavy_box(mass), 1.0 / rate);
      const Record record = run_and_record(world, 1.0 / kSanitizedShare);
      EXPECT_LE(record.drift, 1e-10) << mass << " " << rate;
      EXPECT_LE(record.iterations, 6.0) << mass << " " << rate;
      EXPECT_LE(record.first, 10.0) << mass << " " << rate;
    }
  }
}

TEST(EnergyMomentum, TurnsAHeavyWheelAsTheToleranceAsks) {
  // a spinning load held off its centre by a light bar: it nods and precesses
  const auto make = [](double time_step, Method method, double tolerance) {
    World world;
    Body bar = make_body("bar", Box{{0.02, 0.02, 1.0}}, 0.1, {0.0, 0.0, -0.5});
    bar.no_collision = true;
    const BodyId link = world.add_body(bar);
    Body wheel = make_body("wheel", Box{{0.5, 0.5, 0.2}}, 1e4, {0.0, 0.0, -1.1});
    wheel.no_collision = true;
    wheel.state.angular_velocity = {0.5, 0.0, 20.0};
    const BodyId load = world.add_body(wheel);
    world.add_joint(
        make_joint("top", kWorldBody, Vector3d::Zero(), link, {0.0, 0.0, 0.5}, JointKind::kBall));
    world.add_joint(
        make_joint("hook", link, {0.0, 0.0, -0.5}, load, {0.0, 0.0, 0.1}, JointKind::kBall));
    WorldOptions options;
    options.time_step = time_step;
    options.method = method;
    options.tolerance = tolerance;
    world.set_options(options);
    return world;
  };
  World exact = make(1e-3, Method::kRungeKutta, 1e-9);
  run_and_record(exact, 1.0);
  const BodyId load = exact.find_body("wheel");
  const auto error = [&](double tolerance) {
    World world = make(1.0 / 60.0, Method::kAuto, tolerance);
    const Record record = run_and_record(world, 1.0);
    EXPECT_EQ(record.stiff_steps, 60u);
    EXPECT_LE(record.drift, 1e-9);
    return problems::angle_between(world.state(load).orientation, exact.state(load).orientation);
  };
  const double loose = error(1e-3), tight = error(1e-6);
  EXPECT_LE(loose, 1e-1);
  EXPECT_LE(tight, 1e-4);
  EXPECT_LE(tight, 0.1 * loose);
}

// ---- choice of method

TEST(EnergyMomentum, IsTakenWhereAnIslandIsStiffAndLeftWhereItIsNot) {
  World world = with_method(problems::heavy_chain(1e6, false), 1.0 / 30.0);
  world.step();
  EXPECT_EQ(world.islands().front().method, Method::kEnergyMomentum);  // found stiff at once
  EXPECT_EQ(world.islands().front().why, MethodReason::kStiff);
  EXPECT_EQ(world.report().costs.method_changes, 1u);
  run_and_record(world, 1.0);

  // ω is 2e4/s: at shorter ticks h ω is 5
  const double energy = world.energy();
  world = with_method(world, 1.0 / 4000.0);
  double projected = 0.0;
  for (int i = 0; i < 300; ++i) projected += world.step().energy.projected;
  EXPECT_EQ(world.islands().front().method, Method::kRungeKutta);
  // the change costs the reported energy
  EXPECT_NEAR(world.energy(), energy - projected, 1e-9 * 5e5);

  world = with_method(world, 1.0 / 30.0);
  const Record record = run_and_record(world, 1.0);
  EXPECT_EQ(record.stiff_steps, 30u);
}

TEST(EnergyMomentum, NamesTheBodiesThatItsStepsCannotShow) {
  World world = with_method(problems::heavy_chain(1e6, false), 1.0 / 30.0);
  run(world, 3);
  std::vector<BodyId> links = world.body_ids();
  links.pop_back();  // the load itself swings slowly
  EXPECT_EQ(world.unresolved_bodies(), links);
  EXPECT_EQ(world.report().unresolved_bodies, 10u);
  world.remove_body(links.front());
  EXPECT_TRUE(world.unresolved_bodies().empty());  // unknown until the next step
  World calm = with_method(problems::chain(3), 1.0 / 30.0, Method::kEnergyMomentum);
  run(calm, 3);
  EXPECT_TRUE(calm.unresolved_bodies().empty());
}

/// Two boxes of 100 kg with three of 10 g between them, on ball joints; where `is_held` the first
/// one is also held to the world.
class LightLinks {
 public:
  explicit LightLinks(bool is_held) {
    Random random;
    masses_.emplace_back();
    states_.emplace_back();
    for (int i = 0; i < 5; ++i) {
      MassProperties mass;
      const double kg = i == 0 || i == 4 ? 100.0 : 0.01;
      mass.inverse_mass = 1.0 / kg;
      mass.inertia = kg * Vector3d(0.1, 0.15, 0.2);
      mass.inverse_inertia = mass.inertia.cwiseInverse();
      masses_.push_back(mass);
      BodyState state = random.state();
      state.position = {i + 0.5, 0.0, 0.0};
      state.orientation.setIdentity();
      states_.push_back(state);
    }
    for (std::size_t i = is_held ? 0 : 1; i < 5; ++i) {
      Joint joint;
      joint.kind = JointKind::kBall;
      joint.anchor_a = {i == 0 ? 0.0 : 0.5, 0.0, 0.0};
      joint.anchor_b = {-0.5, 0.0, 0.0};
      joints_.push_back(joint);
      ends_.emplace_back(i, i + 1);
    }
    prescribed_.resize(joints_.size());
    List<int> all(joints_.size());
    std::iota(all.begin(), all.end(), 0);
    motion_.emplace(EquationsOfMotion(all, joints_, ends_, masses_));
  }

  IntegrationResult advance(Integration integration, double h) {
    const Interval interval{t_, h, gravity_, loads_, prescribed_, false, false};
    t_ += h;
    return motion_->advance(integration, interval, {8, 1e-9}, &states_);
  }
  IslandMotion& motion() { return *motion_; }

  double energy() const {
    double sum = 0.0;
    for (std::size_t i = 1; i < states_.size(); ++i) {
      const BodyState& state = states_[i];
      sum += 0.5 * state.linear_velocity.squaredNorm() / masses_[i].inverse_mass;
      sum += 0.5 * state.angular_velocity.dot(apply_inertia(masses_[i].inertia, state.orientation,
                                                            state.angular_velocity));
    }
    return sum;
  }
  Vector3d momentum() const {
    Vector3d sum = Vector3d::Zero();
    for (std::size_t i = 1; i < states_.size(); ++i)
      sum += states_[i].linear_velocity / masses_[i].inverse_mass;
    return sum;
  }
  Vector3d angular_momentum() const {
    Vector3d sum = Vector3d::Zero();
    for (std::size_t i = 1; i < states_.size(); ++i) {
      const BodyState& state = states_[i];
      sum += state.position.cross(state.linear_velocity) / masses_[i].inverse_mass;
      sum += apply_inertia(masses_[i].inertia, state.orientation, state.angular_velocity);
    }
    return sum;
  }

 private:
  double t_ = 0.0;
  Vector3d gravity_ = Vector3d::Zero();
  List<AppliedWrench> loads_;
  List<BodyState> states_;
  List<MassProperties> masses_;
  List<Joint> joints_;
  List<std::pair<std::size_t, std::size_t>> ends_;
  List<PrescribedMotion> prescribed_;
  std::optional<IslandMotion> motion_;
};

// An interval of 1 ns, in which substeps only start. Sums of about 500 J, kg m/s and kg m²/s have
// rounding errors; velocities that do not fit hold at least 1e-8 of the energy.
TEST(EnergyMomentum, KeepsEnergyAndMomentaWhereSubstepsTakeOver) {
  for (const bool is_held : {false, true}) {
    LightLinks links(is_held);
    for (int i = 0; i < 20; ++i)
      ASSERT_TRUE(links.advance(Integration::kEnergyMomentum, 1.0 / 30.0).done) << i;
    LightLinks kept = links;
    const double energy = links.energy();
    const Vector3d P = links.momentum(), L = links.angular_momentum();
    kept.motion().change_method();
    const IntegrationResult result = kept.advance(Integration::kRungeKutta, 1e-9);
    ASSERT_TRUE(result.done);
    EXPECT_NEAR(kept.energy(), energy, 1e-13 * energy);
    EXPECT_NEAR(result.projected, 0.0, 1e-13 * energy);
    if (!is_held) {
      EXPECT_LE((kept.momentum() - P).norm(), 1e-13 * P.norm());
      EXPECT_LE((kept.angular_momentum() - L).norm(), 1e-13 * L.norm());
    }
    // after an external change of bodies the misfit is lost, and reported
    links.motion().forget();
    const double lost = links.advance(Integration::kRungeKutta, 1e-9).projected;
    EXPECT_GT(lost, 1e-8 * energy);
    EXPECT_NEAR(links.energy(), energy - lost, 1e-13 * energy);
  }
}

// The cost of substeps is measured once, and not every 50 ticks.
TEST(EnergyMomentum, RemembersWhatSubstepsCost) {
  World world = with_method(redundant::crane_boom(), 0.01);
  std::uint32_t changes = 0;
  for (int i = 0; i < 300; ++i) changes += world.step().costs.method_changes;
  EXPECT_EQ(world.islands().front().method, Method::kEnergyMomentum);
  EXPECT_EQ(changes, 1u);
}

TEST(EnergyMomentum, ComesAndGoesAsAnIslandGrowsStiffAndCalmAgain) {
  // a winch pulls a mass on a stretched spring line: its links become stiff with the tension
  WorldOptions options;
  options.gravity = Vector3d::Zero();
  options.time_step = 0.02;
  options.stiffness_limit = 4.0;
  World world(options);
  BodyId last = kWorldBody;
  for (int i = 1; i <= 5; ++i) {
    Body body =
        make_body("m" + std::to_string(i), Point{}, i < 5 ? 0.1 : 10.0, {0.2 * i, 0.0, 0.0});
    body.state.linear_velocity = {0.0, 0.01, 0.0};
    const BodyId id = world.add_body(body);
    world.add_joint(
        make_joint("rod" + std::to_string(i), last, Vector3d::Zero(), id, Vector3d::Zero()));
    last = id;
  }
  Joint line = make_joint("line", last, Vector3d::Zero(), kWorldBody, {2.0, 0.0, 0.0},
                          spring(1.0, 2e5, 0.0));
  line.motor.amplitude = 0.06;
  line.motor.frequency = 0.05;
  line.motor.phase = kPi;  // first shorter, by 0.4 m, then back
  world.add_joint(line);
  std::uint32_t changes = 0;
  std::array<int, kMethodCount> ticks{};
  for (int i = 0; i < 2000; ++i) {
    changes += world.step().costs.method_changes;
    ++ticks[index_of(world.islands().front().method)];
    ASSERT_LE(world.report().joints.max_error, round_off(world));
  }
  EXPECT_GT(ticks[index_of(Method::kEnergyMomentum)], 100);
  EXPECT_GT(ticks[index_of(Method::kRungeKutta)], 100);
  EXPECT_EQ(ticks[index_of(Method::kSequentialImpulses)], 0);
  EXPECT_GE(changes, 2u);
  EXPECT_LE(changes, 20u);  // hysteresis prevents a change in every swing
}

TEST(EnergyMomentum, CopiesGoOnBitIdentically) {
  for (const World& scene : {problems::heavy_chain(1e6, false), heavy_box(1e5)}) {
    World world = with_method(scene, 1.0 / 30.0);
    run(world, 20);
    World copy = world;
    run(world, 50);
    run(copy, 50);
    EXPECT_EQ(copy.state_hash(), world.state_hash());
    World again = with_method(scene, 1.0 / 30.0);
    run(again, 70);
    EXPECT_EQ(again.state_hash(), world.state_hash());
  }
}

TEST(EnergyMomentum, AllocatesNothingInAStepWithoutLoops) {
  for (const World& scene : {problems::heavy_chain(1e6, false), heavy_box(1e5)}) {
    World world = with_method(scene, 1.0 / 30.0);
    run(world, 3);
    const std::size_t before = counted_allocations();
    for (int i = 0; i < 100; ++i) world.step();
    EXPECT_EQ(counted_allocations(), before);
  }
}

// ---- springs of any stiffness

TEST(EnergyMomentum, SpringsOfAnyStiffnessAddNoEnergy) {
  for (const double stiffness : {1e6, 1e9, 1e12}) {
    for (const double time_step : {1.0, 0.1, 1.0 / 30.0, 1e-3}) {
      World scene;
      const BodyId bob = scene.add_body(make_body("bob", Point{}, 1.0, {1.0, 0.0, 0.0}));
      const BodyId end = scene.add_body(make_body("end", Point{}, 1.0, {2.0, 0.0, 0.0}));
      scene.add_joint(hang("spring", bob, spring(1.0, stiffness, 0.0)));
      scene.add_joint(make_joint("rod", bob, Vector3d::Zero(), end, Vector3d::Zero()));
      World world = with_method(scene, time_step);
      const Record record = run_and_record(world, 10.0);
      const bool is_stiff = time_step * std::sqrt(2.0 * stiffness) > 40.0;
      EXPECT_EQ(record.stiff_steps > 0, is_stiff) << stiffness << " " << time_step;
      // a hundred times the energy of this spring for rounding of a length of 1 m
      const double rounding = 100.0 * stiffness * kEpsilon * kEpsilon + 1e-10;
      EXPECT_LE(record.drift, rounding) << stiffness << " " << time_step;
    }
  }
}

TEST(EnergyMomentum, AStiffSpringIsAsARodWhereItIsNotExcited) {
  // hung straight and turned slowly, so that its own oscillation is not excited
  World sprung, rigid;
  for (World* scene : {&sprung, &rigid}) {
    Body body = make_body("bob", Point{}, 1.0, {0.0, 0.0, -1.0});
    body.state.linear_velocity = {0.1, 0.0, 0.0};
    scene->add_body(body);
  }
  const double stretch = 9.82 / 1e12;  // weight and centripetal force over stiffness
  sprung.add_joint(hang("spring", sprung.find_body("bob"), spring(1.0 - stretch, 1e12, 0.0)));
  rigid.add_joint(hang("rod", rigid.find_body("bob"), rod(1.0)));
  sprung = with_method(sprung, 0.01);
  rigid = with_method(rigid, 0.01);
  run(sprung, 300);
  run(rigid, 300);
  // order 4 at h ω = 0.03, for a motion of 0.03 m
  EXPECT_LE(problems::largest_difference(sprung, rigid), 1e-8);
}

TEST(EnergyMomentum, AStiffDamperTakesEnergyAndNeverGivesAny) {
  for (const double damping : {1e3, 1e6, 1e9}) {
    World scene;
    const BodyId bob = scene.add_body(make_body("bob", Point{}, 1.0, {1.0, 0.0, 0.0}));
    scene.add_joint(hang("damper", bob, spring(1.0, 100.0, damping)));
    World world = with_method(scene, 0.1);
    world.step();
    EXPECT_EQ(world.islands().front().method, Method::kEnergyMomentum);
    double energy = world.energy();
    for (int i = 0; i < 200; ++i) {
      ASSERT_FALSE(world.step().outcome.failed);
      EXPECT_LE(world.energy(), energy + 1e-10);
      energy = world.energy();
    }
  }
}

// ---- dependent rows

/// A heavy bar on two light uprights of equal length, with a third upright in its middle.
World parallelogram(bool has_third) {
  World world;
  Body bar = make_body("bar", Box{{2.0, 0.1, 0.1}}, 10.0, {0.0, 0.0, 1.0});
  bar.state.linear_velocity = {1.0, 0.0, 0.0};
  const BodyId id = world.add_body(bar);
  for (const double x : {-1.0, 0.0, 1.0}) {
    if (x == 0.0 && !has_third) continue;
    world.add_joint(
        make_joint("upright" + std::to_string(x), kWorldBody, {x, 0.0, 0.0}, id, {x, 0.0, 0.0}));
  }
  return world;
}

TEST(EnergyMomentum, AThirdUprightChangesNothingAndIsReported) {
  for (const Method method : {Method::kAuto, Method::kEnergyMomentum}) {
    World two = with_method(parallelogram(false), 0.01, method);
    World three = with_method(parallelogram(true), 0.01, method);
    std::uint32_t dependent = 0;
    for (int i = 0; i < 500; ++i) {
      two.step();
      dependent = std::max(dependent, three.step().joints.dependent_rows);
      ASSERT_LE(three.report().joints.max_error, round_off(three)) << three.time();
    }
    EXPECT_LE(problems::largest_difference(two, three), 1e-9) << name(method);
    EXPECT_GE(dependent, 1u) << name(method);
  }
}

TEST(EnergyMomentum, DoubledRodsOfAHeavyChainChangeNothing) {
  World single = with_method(problems::heavy_chain(1e6, true), 1.0 / 30.0);
  World scene = problems::heavy_chain(1e6, true);
  const std::vector<BodyId> ids = scene.body_ids();
  problems::add_rod(&scene, kWorldBody, ids[0]);
  problems::add_rod(&scene, ids[3], ids[4]);
  problems::add_rod(&scene, ids[9], ids[10]);
  World doubled = with_method(scene, 1.0 / 30.0);
  run_and_record(single, 3.0);
  const Record record = run_and_record(doubled, 3.0);
  EXPECT_GE(record.stiff_steps, 86u);  // the first few ticks use substeps, to measure their cost
  EXPECT_EQ(doubled.report().joints.dependent_rows, 3u);
  EXPECT_LE(problems::largest_difference(single, doubled), 1e-9);
}

// ---- joints that contradict each other

MethodReason only_reason(const World& world) { return world.islands().front().why; }

TEST(EnergyMomentum, RodsOfTwoLengthsMeetInTheMiddleUntilOneGoes) {
  World world = with_method(World(), 0.01);
  const BodyId bob = problems::add_mass(&world, "bob", {1.0, 0.0, 0.0});
  const JointId shorter = world.add_joint(hang("shorter", bob, rod(1.0)));
  const JointId longer = world.add_joint(hang("longer", bob, rod(1.2)));
  run(world, 100);
  EXPECT_EQ(only_reason(world), MethodReason::kInconsistent);
  const double middle = 1.1;  // mean length in metres; both rods pull the mass equally
  double highest = -kInfinity, lowest = kInfinity;
  for (int i = 0; i < 1000; ++i) {
    ASSERT_FALSE(world.step().outcome.failed);
    EXPECT_NEAR(world.joint_state(shorter).error, middle - 1.0, 1e-9);
    EXPECT_NEAR(world.joint_state(longer).error, middle - 1.2, 1e-9);
    highest = std::max(highest, world.energy());
    lowest = std::min(lowest, world.energy());
  }
  EXPECT_LE(highest - lowest, 0.05);  // a swing of 10 J, without vibration
  EXPECT_EQ(only_reason(world), MethodReason::kInconsistent);

  world.remove_joint(longer);
  run(world, 100);
  EXPECT_EQ(only_reason(world), MethodReason::kSmooth);
  EXPECT_LE(std::abs(world.joint_state(shorter).error), 1e-12);
}

TEST(EnergyMomentum, WhatIsOutOfReachIsPulledStraight) {
  World world = with_method(World(), 0.01);
  const BodyId bob = problems::add_mass(&world, "bob", {1.0, 0.0, -0.2});
  world.add_joint(hang("left", bob, rod(1.0)));
  world.add_joint(
      make_joint("right", kWorldBody, {3.0, 0.0, 0.0}, bob, Vector3d::Zero(), rod(1.0)));
  run(world, 300);
  EXPECT_EQ(only_reason(world), MethodReason::kInconsistent);
  // straight, and below the line by the weight over the stiffness that holds the bob
  EXPECT_LE((world.state(bob).position - Vector3d(1.5, 0.0, 0.0)).norm(), 1e-6);
  EXPECT_LE(world.state(bob).linear_velocity.norm(), 1e-6);
}

TEST(EnergyMomentum, MotorsAgainstEachOtherShareTheDifference) {
  World world = with_method(World(), 0.01);
  const BodyId bob = problems::add_mass(&world, "bob", {1.0, 0.0, 0.0});
  Joint out = hang("out", bob, rod(1.0));
  out.motor.bias = 0.1;
  Joint in = hang("in", bob, rod(1.0));
  in.motor.bias = -0.1;
  const JointId a = world.add_joint(out), b = world.add_joint(in);
  for (int i = 0; i < 100; ++i) {
    ASSERT_FALSE(world.step().outcome.failed);
    EXPECT_EQ(only_reason(world), MethodReason::kInconsistent);
  }
  EXPECT_NEAR(world.joint_state(a).error, -0.1, 1e-9);
  EXPECT_NEAR(world.joint_state(b).error, 0.1, 1e-9);
}

// ---- extremes

/// A ring of light masses, hung from one rod, with a load at its lowest point.
World ring(bool has_crossbar) {
  World world;
  const double offset = has_crossbar ? 0.0 : 0.1;
  const BodyId top = problems::add_mass(&world, "top", {0.0, 0.0, -1.0}, 0.1);
  const BodyId left = problems::add_mass(&world, "left", {-0.5, offset, -2.0}, 0.1);
  const BodyId right = problems::add_mass(&world, "right", {0.5, 0.0, -2.0 - offset}, 0.1);
  const BodyId load = problems::add_mass(&world, "load", {0.0, 0.0, -3.0}, 1e6);
  BodyState pushed = world.state(load);
  pushed.linear_velocity = {0.0, 1.0, 0.0};
  world.set_state(load, pushed);
  problems::add_rod(&world, kWorldBody, top);
  for (const BodyId side : {left, right}) {
    problems::add_rod(&world, top, side);
    problems::add_rod(&world, side, load);
  }
  if (has_crossbar) problems::add_rod(&world, left, right);
  return world;
}

TEST(EnergyMomentum, CarriesLoopsOfHeavyAndLightBodies) {
  World world = with_method(ring(true), 1.0 / 60.0);
  world.step();
  const double energy = world.energy();
  const Record record = run_and_record(world, 5.0);
  EXPECT_GE(record.stiff_steps, 296u);
  EXPECT_LE(record.iterations, 6.0);
  EXPECT_NEAR(world.energy(), energy, 1e-10 * 0.5e6);
}

// Without the crossbar the load falls until one side is taut, and rebounds: 5e7 N for a
// millisecond. Substeps follow the jerk; the island is not stiff before and after.
TEST(EnergyMomentum, LeavesAJerkToSubsteps) {
  World world = with_method(ring(false), 1.0 / 60.0);
  world.step();
  const double energy = world.energy();
  double force = 0.0;
  for (int i = 0; i < 300; ++i) {
    ASSERT_EQ(world.step().costs.islands[index_of(Method::kRungeKutta)], 1u);
    ASSERT_LE(world.report().joints.max_error, round_off(world));
    force = std::max(force, std::abs(world.joint_state(world.joint_ids().front()).force));
  }
  EXPECT_GT(force, 1e7);
  // jerks amplify rounding: a change of the initial speed by 1e-13 changed the energy by 1e-9 to
  // 4e-8
  EXPECT_NEAR(world.energy(), energy, 1e-7 * 0.5e6);
}

TEST(EnergyMomentum, LongTicksAreBounded) {
  for (const double time_step : {0.1, 0.5, 1.0}) {
    for (const double mass : {1.0, 1e3, 1e6, 1e9}) {
      World world = with_method(problems::heavy_chain(mass, false), time_step);
      for (int i = 0; i < 100; ++i) {
        const StepReport& report = world.step();
        ASSERT_FALSE(report.outcome.failed);
        ASSERT_LE(report.joints.max_error, round_off(world)) << mass << " " << time_step;
      }
      EXPECT_LE(std::abs(world.report().energy.drift), 1e-6) << mass << " " << time_step;
    }
  }
}

TEST(EnergyMomentum, AScaledSceneMovesAlike) {
  // lengths times s, masses times m, times times √s: the angles stay the same
  World unit = with_method(problems::heavy_chain(1e6, false), 1.0 / 30.0);
  run_and_record(unit, 1.0);
  for (const double s : {1e-6, 1e-3, 1e3, 1e6}) {
    for (const double m : {1e-6, 1e6}) {
      const World from = problems::heavy_chain(1e6, false);
      WorldOptions options;
      options.time_step = std::sqrt(s) / 30.0;
      options.tolerance = 1e-8 * std::sqrt(s);
      World world(options);
      BodyId last = kWorldBody;
      for (const BodyId id : from.body_ids()) {
        Body body = from.body(id);
        body.mass *= m;
        body.state.position *= s;
        body.state.linear_velocity *= std::sqrt(s);
        const BodyId added = world.add_body(body);
        problems::add_rod(&world, last, added);
        last = added;
      }
      run(world, 30);
      EXPECT_EQ(world.islands().front().method, Method::kEnergyMomentum);
      const Vector3d end = world.state(last).position / s;
      EXPECT_LE((end - unit.state(unit.body_ids().back()).position).norm(), 1e-9) << s << " " << m;
    }
  }
}

TEST(EnergyMomentum, WhereASceneLiesDoesNotDecideWhenNewtonsStepsEnd) {
  // Two boxes on a rod between corners, thrown: the first Newton step of a tick is mostly along
  // directions that the rod leaves free, so rows do not decrease quadratically with the changes.
  for (const double off : {0.0, 1e3}) {
    WorldOptions options;
    options.method = Method::kEnergyMomentum;
    options.time_step = 1.0 / 30.0;
    World world(options);
    const Vector3d place = off * Vector3d(-0.17, -0.23, -0.96);
    Body a;
    a.name = "a";
    a.no_collision = true;
    a.shape = Box{{0.59, 0.47, 0.34}};
    a.mass = 1.23;
    a.state.position = place;
    a.state.orientation = Eigen::Quaterniond(-0.99, 0.01, 0.09, -0.09).normalized();
    a.state.linear_velocity = {-0.25, 0.23, -0.3};
    a.state.angular_velocity = {0.4, -0.05, 0.09};
    Body b;
    b.name = "b";
    b.no_collision = true;
    b.shape = Box{{0.42, 0.59, 0.4}};
    b.mass = 1.29;
    b.state.position = place + Vector3d(-0.23, -0.12, 0.95);
    b.state.orientation = Eigen::Quaterniond(0.33, 0.74, 0.58, 0.03).normalized();
    b.state.linear_velocity = {0.28, 0.21, 0.35};
    b.state.angular_velocity = {0.96, 0.02, -0.17};
    Joint rod;
    rod.kind = JointKind::kDistance;
    rod.name = "rod";
    rod.body_a = world.add_body(a);
    rod.body_b = world.add_body(b);
    rod.anchor_a = {-0.16, -0.3, 0.42};
    rod.anchor_b = {-0.4, 0.07, 0.47};
    world.add_joint(rod);
    double worst = 0.0;
    for (int i = 0; i < 60; ++i) worst = std::max(worst, world.step().joints.max_error);
    // rounding of coordinates, as for every mechanism (docs/mechanisms.md)
    EXPECT_LE(worst, 1e-12 + 4.0 * 2.3e-16 * off) << off;
  }
}

TEST(EnergyMomentum, ABodySpinningAboutItsMiddleAxisKeepsItsEnergy) {
  for (const double time_step : {1.0 / 30.0, 1e-3}) {
    WorldOptions options;
    options.gravity = Vector3d::Zero();
    options.time_step = time_step;
    World world(options);
    Body box = make_body("box", Box{{0.1, 0.4, 0.9}}, 1.0, Vector3d::Zero());
    box.state.angular_velocity = {1e-3, 1e4, 1e-3};
    options.tolerance = 1e-9;
    world.set_options(options);
    const BodyId id = world.add_body(box);
    const double energy = world.energy();
    const auto ticks = std::lround(1.0 / time_step);
    const Vector3d L = angular_momentum(world);
    for (long i = 0; i < ticks; ++i) {
      ASSERT_FALSE(world.step().outcome.failed);
      ASSERT_EQ(world.islands().front().method, Method::kRungeKutta);
    }
    EXPECT_NEAR(world.energy(), energy, 1e-10 * energy) << time_step;
    EXPECT_LE((angular_momentum(world) - L).norm(), 1e-12 * L.norm()) << time_step;
    EXPECT_TRUE(world.state(id).orientation.coeffs().allFinite());
  }
}

/// A light box on a ball joint that holds a load a million times heavier: it turns over within a
/// tick, repeatedly.
World light_between(int seed, JointKind kind) {
  Random random;
  for (int i = 0; i < 37 * seed; ++i) random();
  WorldOptions options;
  options.method = Method::kEnergyMomentum;
  options.time_step = 0.1;
  options.tolerance = 0.0;
  World world(options);
  Joint joint = random_joint(kind, &random);
  const auto box = [&](const std::string& body_name, double mass) {
    const Vector3d size = Vector3d::Constant(0.4) + 0.2 * random.vector();
    Body body = make_body(body_name, Box{size}, mass, Vector3d::Zero());
    body.no_collision = true;
    return body;
  };
  Body light = box("light", 1.0);
  light.state = random.state();
  Body load = box("load", 1e6);
  load.state = attached(joint, light.state, &random);
  load.state.angular_velocity *= 3.0;
  const Vector3d up(0.0, 0.0, 1.0);
  joint.body_a = world.add_body(light);
  joint.body_b = world.add_body(load);
  world.add_joint(joint);
  world.add_joint(make_joint("hook", kWorldBody, light.state.position + up, joint.body_a,
                             light.state.orientation.conjugate() * up, JointKind::kBall));
  return world;
}

// Where Newton's method fails, substeps and shorter steps take over, without a tolerance of their
// own and from velocities that do not fit the joints. The bound 1e-6 of the energies is the
// report's limit for an unexplained rise.
TEST(EnergyMomentum, WhatStandsInForItKeepsTheEnergy) {
  for (const auto& [seed, kind] :
       {std::pair(2, JointKind::kDistance), {5, JointKind::kUniversal}}) {
    if (kSanitizedShare > 1 && seed > 2) break;
    World world = light_between(seed, kind);
    world.step();  // makes the velocities fit
    double before = world.energy(), scale = std::abs(before);
    std::uint32_t changes = 0;
    for (int i = 0; i < 9; ++i) {
      const StepReport& report = world.step();
      ASSERT_FALSE(report.outcome.failed);
      changes += report.costs.method_changes;
      scale = std::max({scale, std::abs(world.energy()), 1e6 * kGravity});
      EXPECT_NEAR(world.energy(), before, 1e-6 * scale) << name(kind) << " at " << world.time();
      before = world.energy();
    }
    EXPECT_GT(changes, 0u) << name(kind);
  }
}

TEST(EnergyMomentum, InertiasMayDifferAMillionfold) {
  for (const Vector3d& inertia :
       {Vector3d(1e-6, 1.0, 1.0), Vector3d(1.0, 1e-3, 1.0), Vector3d(1e-3, 1e-3, 2e-3)}) {
    World scene;
    Body body = make_body("needle", Point{}, 1.0, {0.0, 0.0, -0.5});
    body.inertia = inertia;
    body.state.angular_velocity = {1.0, 0.3, 5.0};
    const BodyId needle = scene.add_body(body);
    scene.add_joint(make_joint("ball", kWorldBody, {0.01, 0.0, 0.0}, needle, {0.01, 0.0, 0.5},
                               JointKind::kBall));
    Body load = make_body("load", Point{}, 1e3, {0.0, 0.0, -1.5});
    load.inertia = Vector3d::Constant(1e3);
    const BodyId end = scene.add_body(load);
    scene.add_joint(
        make_joint("low", needle, {0.0, 0.01, -0.5}, end, {0.0, 0.01, 0.5}, JointKind::kBall));
    WorldOptions options = scene.options();
    options.method = Method::kEnergyMomentum;
    options.time_step = 1.0 / 30.0;
    scene.set_options(options);
    World world = scene;
    world.step();  // makes the velocities fit
    const double energy = world.energy();
    const Record record = run_and_record(world, 5.0);
    EXPECT_GT(record.stiff_steps, 100u) << inertia.transpose();
    EXPECT_NEAR(world.energy(), energy, 1e-10 * 1e3) << inertia.transpose();
  }
}

}  // namespace
}  // namespace constraint_sim::engine
