// Bodies that springs, motors, wrenches and joints accelerate within a step, towards shapes that
// velocities and gravity at the start of the step do not reach. Oracles: a wall keeps everything on
// its near side; closed forms; the same scene at short time steps; the same scene without a wall.

#include <array>
#include <optional>

#include "constraint_sim/engine/plan.h"
#include "constraint_sim/engine/snapshot.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr double kPathTimeSteps[] = {1.0 / 30.0, 1.0 / 60.0, 1.0 / 240.0, 1.0 / 1000.0};
const int kPathSeeds = std::max(2, 100 / kSeedShare);

double drawn_between(double low, double high, Draw* random) {
  return low + random->share() * (high - low);
}

enum class Drive { kWrench, kSpring, kRodSpring, kMotor, kForce, kServo };
constexpr Drive kDrives[] = {Drive::kWrench, Drive::kSpring, Drive::kRodSpring,
                             Drive::kMotor,  Drive::kForce,  Drive::kServo};

const char* name_of(Drive drive) {
  constexpr const char* kNames[] = {"wrench", "spring", "rod_spring", "motor", "force", "servo"};
  return kNames[static_cast<std::size_t>(drive)];
}

/// Frame of a scene: moved, turned and scaled.
struct SceneFrame {
  Vector3d shift = Vector3d::Zero();
  Quaterniond turn = Quaterniond::Identity();
  double scale = 1.0;

  explicit SceneFrame(Draw* random)
      : shift(3.0 * random->vector()),
        turn(random->turn()),
        scale(std::pow(10.0, drawn_between(-1.0, 1.0, random))) {}

  Vector3d point(const Vector3d& p) const { return shift + turn * (scale * p); }
  /// Coordinate along x of a point of the scene, before scaling.
  double x(const Vector3d& p) const { return (turn.conjugate() * (p - shift)).x() / scale; }
  Body place(Body body) const {
    body.state.position = point(body.state.position);
    body.state.orientation = turn * body.state.orientation;
    return body;
  }
};

Quaterniond z_along_x() { return frame_along(Vector3d::UnitX()); }

/// A body that a drive shoots along x from the origin, and a target in front of it, with lengths
/// before the scene is scaled.
struct Shot {
  enum class Form { kSphere, kBox, kCylinder };

  SceneFrame frame;
  double gap, thickness, mass, acceleration, travel;
  Form form, target;
  bool is_plane, has_shape_pose;

  static constexpr double kRadius = 0.02;

  explicit Shot(Draw* random)
      : frame(random),
        gap(drawn_between(0.02, 0.5, random)),
        thickness(drawn_between(0.005, 0.2, random)),
        mass(std::pow(10.0, drawn_between(-1.5, 1.0, random))),
        acceleration(std::pow(10.0, drawn_between(2.0, 4.0, random))),
        travel(gap + drawn_between(0.5, 3.0, random)),
        form(static_cast<Form>(random->below(3))),
        target(static_cast<Form>(random->below(3))),
        is_plane(random->below(4) == 0),
        has_shape_pose(random->below(3) == 0) {}

  double length(double share) const { return frame.scale * share; }
  double force() const { return mass * length(acceleration); }
  bool has_cylinder() const { return form == Form::kCylinder || target == Form::kCylinder; }
  /// Thickness of the thinner shape before a static target.
  double thinner() const { return is_plane ? 2.0 * kRadius : std::min(thickness, 2.0 * kRadius); }

  Body shot() const {
    const double r = length(kRadius);
    const Shape shapes[] = {Sphere{r}, Box{Vector3d::Constant(2.0 * r)}, Cylinder{r, 2.0 * r}};
    Body body = make_body("shot", shapes[static_cast<std::size_t>(form)], mass, Vector3d::Zero());
    if (form == Form::kCylinder) body.state.orientation = z_along_x();
    if (has_shape_pose) {  // another frame of the same body: its axes are permuted
      const Quaterniond other(0.5, 0.5, 0.5, 0.5);
      body.inertia = (other.conjugate() * Vector3d(mass * unit_inertia(body.shape))).cwiseAbs();
      body.state.orientation = body.state.orientation * other;
      body.shape_pose = ShapePose{Vector3d::Zero(), other.conjugate()};
    }
    return frame.place(body);
  }

  /// A target whose face, or nearest point, is at gap + kRadius.
  Body wall(BodyType type, double its_mass) const {
    const double t = length(thickness);
    Body body = make_body("wall", Box{{t, length(4.0), length(4.0)}}, its_mass,
                          {gap + kRadius + 0.5 * thickness, 0.0, 0.0});
    body.type = type;
    if (target == Form::kSphere) body.shape = Sphere{0.5 * t};
    if (target == Form::kCylinder) {
      body.shape = Cylinder{length(1.0), t};
      body.state.orientation = z_along_x();
    }
    if (is_plane && type == BodyType::kStatic) {
      body.shape = Plane{};
      body.state.position = {gap + kRadius, 0.0, 0.0};
      body.state.orientation = frame_along(-Vector3d::UnitX());
    }
    return frame.place(body);
  }

  /// Adds the drive of the shot.
  void drive(Drive drive, BodyId id, World* world) const {
    if (drive == Drive::kWrench) {
      Wrench wrench;
      wrench.body = id;
      wrench.force = frame.turn * Vector3d(force(), 0.0, 0.0);
      world->add_wrench(wrench);
      return;
    }
    const double stiffness = force() / length(travel);
    if (drive == Drive::kRodSpring) {
      Joint joint = make_joint("spring", kWorldBody, frame.point({-0.1, 0.0, 0.0}), id,
                               Vector3d::Zero(), spring(length(travel + 0.1), stiffness, 0.0));
      world->add_joint(joint);
    }
    Joint rail;
    rail.name = "rail";
    rail.kind = JointKind::kSlider;
    rail.anchor_a = frame.shift;
    rail.body_b = id;
    rail.frame_a = frame.turn * z_along_x();
    CoordinateLaw& law = rail.coordinates[0];
    Motor motor;
    if (drive == Drive::kSpring) {
      law.stiffness = stiffness;
      law.rest = length(travel);
    } else if (drive == Drive::kMotor) {
      motor.bias = std::sqrt(acceleration) * frame.scale;
      motor.max_force = 10.0 * force();
      law.motor = motor;
    } else if (drive == Drive::kForce) {
      motor.force = force();
      law.motor = motor;
    } else if (drive == Drive::kServo) {
      motor.position = length(travel);
      motor.servo_stiffness = stiffness;
      motor.servo_damping = 0.1 * std::sqrt(stiffness * mass);
      motor.max_force = 2.0 * force();
      law.motor = motor;
    }
    world->add_joint(rail);
  }

  std::string text(Drive drive, int seed, double h) const {
    constexpr const char* kNames[] = {"sphere", "box", "cylinder"};
    return std::string(name_of(drive)) + " " + std::to_string(seed) + ": " +
           kNames[static_cast<std::size_t>(form)] + " on " +
           (is_plane ? "plane" : kNames[static_cast<std::size_t>(target)]) + " at 1/" +
           std::to_string(std::lround(1.0 / h));
  }
};

WorldOptions options_by(Method method, double h) {
  WorldOptions options = weightless(h);
  options.method = method;
  return options;
}

class AssumedPaths : public testing::TestWithParam<Drive> {};

// Contacts are located by events, to rounding, where no shape is a cylinder.
TEST_P(AssumedPaths, EndAtTargets) {
  Random random;
  for (int seed = 0; seed < kPathSeeds; ++seed) {
    Shot shot(&random);
    // only flat targets keep a free body from rolling off
    if (GetParam() == Drive::kWrench && shot.target == Shot::Form::kSphere)
      shot.target = Shot::Form::kBox;
    if (shot.has_cylinder()) continue;
    for (const double h : kPathTimeSteps) {
      World world(options_by(Method::kAuto, h));
      world.add_body(shot.wall(BodyType::kStatic, 1.0));
      const BodyId id = world.add_body(shot.shot());
      shot.drive(GetParam(), id, &world);
      for (int i = 0; i < std::lround(0.2 / h); ++i) {
        ASSERT_FALSE(world.step().outcome.failed);
        ASSERT_FALSE(world.report().contacts.hits_left_body) << shot.text(GetParam(), seed, h);
        ASSERT_LE(shot.frame.x(world.state(id).position), shot.gap + 1e-6)
            << shot.text(GetParam(), seed, h) << ", t = " << world.time();
      }
    }
  }
}

// By impulses, which also advance cylinders, a body ends before its target, or the report names it.
// Overlaps deeper than half of the thinner shape are named in the step after.
TEST_P(AssumedPaths, MeetTargetsByImpulses) {
  Random random;
  for (int seed = 0; seed < kPathSeeds; ++seed) {
    Shot shot(&random);
    if (GetParam() == Drive::kWrench && shot.target == Shot::Form::kSphere)
      shot.target = Shot::Form::kBox;
    for (const Method method : {Method::kAuto, Method::kRungeKutta, Method::kSequentialImpulses}) {
      if (method == Method::kAuto && !shot.has_cylinder()) continue;
      for (const double h : kPathTimeSteps) {
        World world(options_by(method, h));
        world.add_body(shot.wall(BodyType::kStatic, 1.0));
        const BodyId id = world.add_body(shot.shot());
        shot.drive(GetParam(), id, &world);
        bool is_named = false;
        double x = 0.0;
        for (int i = 0; i <= std::lround(0.2 / h); ++i) {
          x = shot.frame.x(world.state(id).position);
          ASSERT_FALSE(world.step().outcome.failed);
          is_named = is_named || world.report().contacts.hits_left_body ||
                     world.report().contacts.overlap > 0.0;
        }
        if (is_named) continue;
        EXPECT_LE(x, shot.gap + 0.5 * shot.thinner())
            << shot.text(GetParam(), seed, h) << " by " << name(method);
      }
    }
  }
}

/// Places of a shot and of a free body that it hits, at a time [s].
std::array<double, 2> places_at(const Shot& shot, Drive drive, double h, double time) {
  World world(options_by(Method::kAuto, h));
  const BodyId target = world.add_body(shot.wall(BodyType::kDynamic, 2.0 * shot.mass));
  const BodyId id = world.add_body(shot.shot());
  shot.drive(drive, id, &world);
  for (int i = 0; i < std::lround(time / h); ++i)
    EXPECT_FALSE(world.step().outcome.failed) << shot.text(drive, 0, h);
  return {shot.frame.x(world.state(id).position), shot.frame.x(world.state(target).position)};
}

// Bodies that are hit leave, or are pushed along, as they are at time steps of 1/3000 s. Events are
// located to rounding, so both agree to 1e-6 of the distance.
TEST_P(AssumedPaths, PushFreeBodiesAsAtShortTimeSteps) {
  Random random;
  for (int seed = 0; seed < kPathSeeds; ++seed) {
    Shot shot(&random);
    if (shot.form == Shot::Form::kCylinder) shot.form = Shot::Form::kSphere;
    shot.target = Shot::Form::kBox;
    constexpr double kTime = 0.1;  // a whole number of each time step
    const std::array<double, 2> right = places_at(shot, GetParam(), 1.0 / 3000.0, kTime);
    for (const double h : kPathTimeSteps) {
      const std::array<double, 2> places = places_at(shot, GetParam(), h, kTime);
      for (std::size_t k = 0; k < 2; ++k)
        EXPECT_NEAR(places[k], right[k], 1e-6 * (1.0 + std::abs(right[k])))
            << shot.text(GetParam(), seed, h) << (k == 0 ? ", shot" : ", target");
    }
  }
}

// A shape that is far enough aside is not there: bodies move to the bit as without it.
TEST_P(AssumedPaths, LeaveMotionsAloneThatMeetNothing) {
  Random random;
  for (int seed = 0; seed < 5; ++seed) {
    const Shot shot(&random);
    World alone(options_by(Method::kAuto, 1.0 / 60.0));
    World beside(options_by(Method::kAuto, 1.0 / 60.0));
    std::array<BodyId, 2> ids;
    for (World* world : {&alone, &beside}) {
      const BodyId id = world->add_body(shot.shot());
      shot.drive(GetParam(), id, world);
      ids[world == &beside] = id;
    }
    Body far = make_body("far", Box{Vector3d::Constant(shot.length(0.1))}, 1.0, {0.0, 50.0, 0.0});
    far.type = BodyType::kStatic;
    beside.add_body(shot.frame.place(far));
    for (int i = 0; i < 20; ++i) {
      alone.step();
      beside.step();
      ASSERT_EQ(alone.state(ids[0]).position, beside.state(ids[1]).position)
          << shot.text(GetParam(), seed, 1.0 / 60.0);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Drives, AssumedPaths, testing::ValuesIn(kDrives),
                         [](const auto& drive) { return std::string(name_of(drive.param)); });

// A ball at the end of an arm, which a motor swings from rest against a ball on the circle. With
// arm ℓ and radii r the centres come as near as 2 r at the angle 2 asin(r/ℓ) before the post.
TEST(AssumedPathsOfArms, EndAtPosts) {
  constexpr double kArm = 1.0, kBall = 0.02, kPost = 0.5 * kPi;
  const double right = kPost - 2.0 * std::asin(kBall / kArm);
  Random random;
  for (const double torque : {10.0, 100.0, 1000.0}) {
    const SceneFrame frame(&random);
    const double s = frame.scale;
    for (const bool has_arm : {false, true}) {  // the ball is its own body, or a shape on the arm
      for (const double h : kPathTimeSteps) {
        World world(options_by(Method::kAuto, h));
        Body post = make_body("post", Sphere{s * kBall}, 1.0, {0.0, kArm, 0.0});
        post.type = BodyType::kStatic;
        world.add_body(frame.place(post));
        Body ball =
            make_body("ball", Sphere{s * kBall}, 0.1, {has_arm ? 0.5 * kArm : kArm, 0.0, 0.0});
        ball.inertia = Vector3d::Constant(0.01 * s * s);
        if (has_arm)
          ball.shape_pose = ShapePose{{0.5 * s * kArm, 0.0, 0.0}, Quaterniond::Identity()};
        Joint hinge;
        hinge.name = "hinge";
        hinge.kind = JointKind::kHinge;
        hinge.anchor_a = frame.shift;
        hinge.frame_a = frame.turn;
        hinge.body_b = world.add_body(frame.place(ball));
        hinge.anchor_b = {-s * (has_arm ? 0.5 : 1.0) * kArm, 0.0, 0.0};
        Motor motor;
        motor.force = torque * s * s;
        hinge.coordinates[0].motor = motor;
        const JointId id = world.add_joint(hinge);
        for (int i = 0; i < std::lround(0.3 / h); ++i) {
          ASSERT_FALSE(world.step().outcome.failed);
          ASSERT_LE(world.joint_state(id).coordinates[0].position, right + 1e-6)
              << torque << " N m at 1/" << 1.0 / h << (has_arm ? " on an arm" : "");
        }
        EXPECT_NEAR(world.joint_state(id).coordinates[0].position, right, 1e-6)
            << torque << " N m at 1/" << 1.0 / h << (has_arm ? " on an arm" : "");
      }
    }
  }
}

// A body on a rod that another body drags: the joint accelerates it, no law or wrench acts on it.
TEST(AssumedPathsOfJoints, EndAtWallsThatOthersDragThemTo) {
  for (const Method method : {Method::kAuto, Method::kSequentialImpulses}) {
    for (const double h : kPathTimeSteps) {
      World world(options_by(method, h));
      Body wall = make_body("wall", Box{{0.1, 4.0, 4.0}}, 1.0, {0.1, 0.0, 0.0});
      wall.type = BodyType::kStatic;
      world.add_body(wall);
      Body tug = make_body("tug", Point{}, 0.2, {1.0, 0.0, 0.0});
      const BodyId front = world.add_body(tug);
      const BodyId behind = world.add_body(make_body("ball", Sphere{0.02}, 0.2, Vector3d::Zero()));
      world.add_joint(make_joint("rod", front, Vector3d::Zero(), behind, Vector3d::Zero()));
      Wrench wrench;
      wrench.body = front;
      wrench.force.x() = 800.0;
      world.add_wrench(wrench);
      const double allowed = method == Method::kAuto ? 1e-6 : 0.01;
      for (int i = 0; i < std::lround(0.3 / h); ++i) {
        ASSERT_FALSE(world.step().outcome.failed);
        ASSERT_LE(world.state(behind).position.x(), 0.03 + allowed)
            << name(method) << " at 1/" << 1.0 / h << ", t = " << world.time();
      }
    }
  }
}

/// A wrench that pushes a ball from rest through a wall of 10 cm.
World wrench_at_wall(const WorldOptions& options) {
  World world(options);
  Body wall = make_body("wall", Box{{0.1, 4.0, 4.0}}, 1.0, {0.1, 0.0, 0.0});
  wall.type = BodyType::kStatic;
  world.add_body(wall);
  Wrench wrench;
  wrench.body = world.add_body(make_body("ball", Sphere{0.02}, 0.2, Vector3d::Zero()));
  wrench.force.x() = 800.0;
  world.add_wrench(wrench);
  return world;
}

// A repeated step has the same bits from a copy and from a snapshot of the world.
TEST(RepeatedSteps, HaveTheBitsOfCopiesAndSnapshots) {
  for (const Method method : {Method::kAuto, Method::kRungeKutta, Method::kSequentialImpulses}) {
    World world = wrench_at_wall(options_by(method, 1.0 / 60.0));
    for (int i = 0; i < 6; ++i) {
      World copy = world;
      World read = read_snapshot(write_snapshot(world));
      for (World* other : {&world, &copy, &read}) ASSERT_FALSE(other->step().outcome.failed);
      EXPECT_EQ(copy.state_hash(), world.state_hash()) << name(method) << ", step " << i;
      EXPECT_EQ(read.state_hash(), world.state_hash()) << name(method) << ", step " << i;
    }
  }
}

// Islands beside a repeated step move as without it, up to the rounding of a method that restarts,
// and no event is reported twice.
TEST(RepeatedSteps, LeaveOtherIslandsAlone) {
  const auto add_pendulum = [](World* world) {
    Body bob = make_body("bob", Sphere{0.05}, 1.0, {1.0, 5.0, 0.0});
    const BodyId id = world->add_body(bob);
    world->add_joint(make_joint("rod", kWorldBody, {0.0, 5.0, 0.0}, id, Vector3d::Zero()));
    return id;
  };
  WorldOptions options;
  options.time_step = 1.0 / 60.0;
  World alone(options);
  World beside = wrench_at_wall(options);
  const BodyId id_alone = add_pendulum(&alone), id_beside = add_pendulum(&beside);
  int began = 0;
  for (int i = 0; i < 60; ++i) {
    ASSERT_FALSE(alone.step().outcome.failed);
    ASSERT_FALSE(beside.step().outcome.failed);
    for (const Event& event : beside.events()) began += event.kind == EventKind::kContactBegan;
    // the default tolerance of 1e-9 m/s over a second
    EXPECT_LE((alone.state(id_alone).position - beside.state(id_beside).position).norm(), 1e-9);
  }
  EXPECT_EQ(began, 1);
}

// Where impulses would need more parts of a step than they take, the body is named.
TEST(RepeatedSteps, NameBodiesThatMayStillPassThrough) {
  WorldOptions options = options_by(Method::kSequentialImpulses, 1.0 / 30.0);
  World world(options);
  Body plate = make_body("plate", Box{{1e-6, 4.0, 4.0}}, 1.0, {0.1, 0.0, 0.0});
  plate.type = BodyType::kStatic;
  world.add_body(plate);
  Wrench wrench;
  wrench.body = world.add_body(make_body("ball", Sphere{0.02}, 0.2, Vector3d::Zero()));
  wrench.force.x() = 2e5;
  world.add_wrench(wrench);
  ASSERT_FALSE(world.step().outcome.failed);
  ASSERT_TRUE(world.report().contacts.hits_left_body ||
              world.state(wrench.body).position.x() < 0.08);
  if (world.report().contacts.hits_left_body) {
    EXPECT_EQ(world.report().contacts.hits_left_body, wrench.body);
    EXPECT_EQ(faults_of(world).size(), 1u);
  }
}

}  // namespace
}  // namespace constraint_sim::engine
