// Sequences of edits: any bytes are edits of a world, with valid and invalid arguments, and between
// them steps, copies, snapshots, saves and queries. A rejected edit changes nothing; a copy
// continues with the same bits.

#include <fuzzer/FuzzedDataProvider.h>

#include <optional>

#include "checks.h"
#include "constraint_sim/engine/plan.h"
#include "custom_types.h"

using namespace constraint_sim;
using namespace constraint_sim::engine;

namespace {

constexpr std::size_t kMostBodies = 10, kMostJoints = 14;
constexpr int kMostEdits = 60, kMostStoppedSteps = 2;

/// A force of any size, 10^exponent N along x.
struct PowerForce : CustomForce {
  double exponent;
  explicit PowerForce(double exponent) : exponent(exponent) {}
  CustomWrench wrench(double /*t*/, const FramePair& /*at*/,
                      const FramePair& /*rates*/) const override {
    return {std::pow(10.0, exponent) * Eigen::Vector3d::UnitX(), Eigen::Vector3d::Zero()};
  }
};

class Editor {
 public:
  Editor(const std::uint8_t* data, std::size_t size)
      : digest_(fuzz::digest(data, size)), data_(data, size) {
    WorldOptions options;
    set_options(&options);
    try {
      world_ = World(options);
    } catch (const std::invalid_argument&) {
    }
  }

  void run() {
    for (int k = 0; k < kMostEdits && data_.remaining_bytes() > 0; ++k) edit();
    step(&world_, &hash_);
    if (fuzz::is_one_of(4, digest_)) fuzz::check_snapshot(world_, &hash_);
    if (saves_) fuzz::check_saved(world_);
  }

 private:
  static fuzz::Watchdog& watchdog() {
    static fuzz::Watchdog one;
    return one;
  }

  // ---- arguments

  /// Returns a number, mostly from -2 to 2, sometimes an extreme one.
  double number() {
    static const double kAny[] = {0.0,
                                  -0.0,
                                  1.0,
                                  -1.0,
                                  1e-20,
                                  1e20,
                                  -1e20,
                                  1e-300,
                                  1e300,
                                  1e-9,
                                  1e9,
                                  3.1416,
                                  0.01,
                                  100,
                                  1e6,
                                  -1e6,
                                  1e150,
                                  2.2e-308,
                                  -1e-310,
                                  1e19,
                                  std::numeric_limits<double>::infinity(),
                                  -std::numeric_limits<double>::infinity(),
                                  std::numeric_limits<double>::quiet_NaN()};
    const auto byte = data_.ConsumeIntegral<std::uint8_t>();
    if (byte < 200) return (byte - 100) / 50.0;
    return kAny[byte % std::size(kAny)];
  }
  double positive() { return std::abs(number()); }
  bool flag() { return data_.ConsumeBool(); }
  int below(int n) { return data_.ConsumeIntegralInRange(0, n - 1); }
  Eigen::Vector3d vector() {
    const double x = number(), y = number();
    return {x, y, number()};
  }
  Eigen::Quaterniond orientation() {
    Eigen::Quaterniond q;
    q.coeffs() << vector(), number();
    return flag() && q.norm() > 0.0 ? q.normalized() : q;
  }
  BodyState state() {
    BodyState state;
    state.position = vector();
    if (flag()) state.orientation = orientation();
    if (flag()) state.linear_velocity = vector();
    if (flag()) state.angular_velocity = vector();
    return state;
  }
  std::string name(const char* kind) { return kind + std::to_string(below(20)); }
  /// Returns an existing body, the world, or a body that may not exist.
  BodyId body() {
    const std::vector<BodyId> ids = world_.body_ids();
    const int choice = below(16);
    if (choice == 0) return kWorldBody;
    if (choice == 1) return BodyId{data_.ConsumeIntegral<std::uint32_t>()};
    return ids.empty() ? kWorldBody : ids[static_cast<std::size_t>(choice) % ids.size()];
  }
  JointId joint() {
    const std::vector<JointId>& ids = world_.joint_ids();
    const int choice = below(16);
    if (choice == 0 || ids.empty()) return JointId{data_.ConsumeIntegral<std::uint32_t>()};
    return ids[static_cast<std::size_t>(choice) % ids.size()];
  }
  /// Returns the hull of up to eight points, or one without a surface where they have none.
  Hull hull() {
    std::vector<Eigen::Vector3d> points(static_cast<std::size_t>(below(9)));
    for (Eigen::Vector3d& point : points) point = vector();
    try {
      return Hull(points);
    } catch (const std::invalid_argument& rejected) {
      fuzz::require(std::string(rejected.what()).size() < 1000, "an answer is long");
      return Hull();
    }
  }
  Shape shape() {
    const auto byte = data_.ConsumeIntegral<std::uint8_t>();
    if (byte >= 240) return Capsule{positive(), positive()};
    if (byte >= 200) return hull();
    switch (byte % 5) {
      case 0:
        return Point{};
      case 1:
        return Sphere{positive()};
      case 2:
        return Box{vector().cwiseAbs()};
      case 3:
        return Plane{};
      default:
        return Cylinder{positive(), positive()};
    }
  }
  Body new_body() {
    Body body;
    body.name = name("b");
    const int type = below(8);
    body.type = type == 0   ? BodyType::kStatic
                : type == 1 ? BodyType::kKinematic
                            : BodyType::kDynamic;
    body.shape = shape();
    body.mass = positive();
    if (flag()) body.inertia = vector().cwiseAbs();
    if (below(8) == 0) body.shape_pose = ShapePose{vector(), orientation()};
    body.state = state();
    body.friction = flag() ? positive() : 0.0;
    body.restitution = flag() ? positive() : 0.0;
    body.no_collision = below(4) == 0;
    if (below(8) == 0) {
      body.collision_groups = static_cast<std::uint32_t>(below(4));
      body.collision_mask = static_cast<std::uint32_t>(below(4));
    }
    return body;
  }
  Motor motor() {
    Motor motor;
    set_motor(&motor);
    return motor;
  }
  void set_motor(Motor* motor) {
    motor->bias = number();
    if (flag()) motor->amplitude = number();
    if (flag()) motor->frequency = positive();
    if (flag()) motor->phase = number();
    if (flag()) motor->max_force = positive();
    if (flag()) motor->timeout = positive();
  }
  Motor coordinate_motor() {
    Motor motor;
    set_motor(&motor);
    if (flag()) motor.position = number();
    if (below(4) == 0) motor.servo_frequency = positive();
    if (below(4) == 0) motor.servo_stiffness = positive();
    if (below(4) == 0) motor.servo_damping = positive();
    if (below(4) == 0) motor.force = number();
    return motor;
  }
  CoordinateLaw law() {
    CoordinateLaw law;
    if (flag()) law.motor = coordinate_motor();
    if (flag()) law.lower = number();
    if (flag()) law.upper = number();
    if (below(4) == 0) law.limit_restitution = positive();
    if (below(4) == 0) law.friction = positive();
    if (below(4) == 0) law.damping = positive();
    if (below(4) == 0) law.stiffness = positive();
    if (below(4) == 0) law.rest = number();
    if (below(4) == 0) law.frequency = positive();
    if (below(4) == 0) law.damping_ratio = positive();
    if (below(4) == 0) law.position = number();
    return law;
  }
  void set_settings(Joint* joint) {
    if (below(4) == 0) joint->baumgarte = number();
    if (below(8) == 0) joint->break_force = positive();
    if (below(8) == 0) joint->break_torque = positive();
    joint->collide_connected = below(4) == 0;
    joint->enabled = below(8) != 0;
    if (DistanceJoint* distance = if_distance(*joint)) {
      if (flag()) distance->length = positive();
      if (below(4) == 0) distance->min_length = positive();
      if (below(4) == 0) distance->max_length = positive();
      if (below(4) == 0) distance->frequency = positive();
      if (below(4) == 0) distance->damping_ratio = positive();
      if (below(4) == 0) distance->stiffness = positive();
      if (below(4) == 0) distance->damping = positive();
      if (below(4) == 0) joint->motor = motor();
    }
    for (int i = 0; i < info(joint->kind).coordinates; ++i)
      if (below(3) == 0) joint->coordinates[static_cast<std::size_t>(i)] = law();
  }
  Joint new_joint() {
    Joint joint;
    joint.name = name("j");
    joint.kind = static_cast<JointKind>(below(static_cast<int>(kJointKindCount)));
    joint.body_a = flag() ? kWorldBody : body();
    joint.body_b = body();
    if (flag()) joint.anchor_a = vector();
    if (flag()) joint.anchor_b = vector();
    if (flag()) joint.frame_a = orientation();
    if (below(3) == 0) joint.frame_b = orientation();
    if (below(6) == 0) joint.axis_b = vector();
    set_settings(&joint);
    if (info(joint.kind).couples) {
      joint.coupling.first = this->joint();
      joint.coupling.second = this->joint();
      joint.coupling.ratio = number();
      if (flag()) joint.coupling.value = number();
      joint.pitch = number();
    }
    if (joint.kind == JointKind::kCustom) {
      joint.custom.type = below(2) == 0 ? "test/rod" : "test/right_angle";
      if (joint.custom.type == "test/rod")
        joint.custom.parameters = {{"length", positive()}, {"squared", flag() ? 1.0 : 0.0}};
    }
    if (joint.kind == JointKind::kCustomForce) {
      joint.custom.type = below(2) == 0 ? "test/drag" : "fuzz/power";
      joint.custom.parameters = {{"c", number()}, {"wind", number()}, {"exponent", number()}};
    }
    return joint;
  }
  void set_options(WorldOptions* options) {
    static const double kTicks[] = {0.01, 1.0 / 60.0, 0.1, 0.001, 1e-12, 1.0, 1e6, 1e-6};
    if (flag()) options->method = static_cast<Method>(below(static_cast<int>(kMethodCount)));
    if (flag()) options->time_step = kTicks[below(8)];
    if (flag()) options->gravity = vector();
    if (below(4) == 0) options->order = flag() ? 5 : 8;
    if (below(4) == 0) options->tolerance = positive();
    if (below(4) == 0) options->stiff_order = flag() ? 2 : 4;
    if (below(4) == 0) options->dissipation = flag();
    if (below(4) == 0) options->stiffness_limit = positive();
    if (below(4) == 0) options->iterations = below(40);
    if (below(4) == 0) options->warm_starting = flag();
    if (below(4) == 0) options->baumgarte = number();
    if (below(4) == 0) options->closing_time = positive();
    if (below(4) == 0) options->sleep_after = positive();
    if (below(4) == 0) options->sleep_speed = positive();
    // by the digest, which takes no bytes: older inputs of the corpus keep their meaning
    if (fuzz::is_one_of(8, digest_)) options->contact_tolerance = 1e-4;
  }

  // ---- edits

  /// Steps a world, unless this input has spent its time on steps that were stopped.
  void step(World* world, fuzz::KnownHash* hash) {
    if (stopped_steps_ >= kMostStoppedSteps) return;
    fuzz::step(&watchdog(), fuzz::step_interval(digest_, stopped_steps_), world, hash);
    if (world->report().outcome.stopped) ++stopped_steps_;
  }

  /// Tries an edit; a rejected one must leave the world unchanged.
  template <class Action>
  void attempt(Action action) {
    const std::uint64_t before = hashes_ ? hash_.of(world_) : 0;
    try {
      action();
      hash_.forget();
    } catch (const std::invalid_argument& rejected) {
      fuzz::require(!hashes_ || world_.state_hash() == before,
                    "a rejected edit has changed the world: " + std::string(rejected.what()));
      fuzz::require(std::string(rejected.what()).size() < 1000, "an answer is long");
    }
  }

  void edit() {
    switch (below(24)) {
      case 0:
      case 1:
      case 2: {
        const Body body = new_body();
        if (world_.body_ids().size() < kMostBodies) attempt([&] { world_.add_body(body); });
        break;
      }
      case 3:
        attempt([&, id = body()] { world_.remove_body(id); });
        break;
      case 4: {
        const BodyId id = body();
        Body changed = new_body();
        if (flag() && world_.has_body(changed.name) && id == world_.find_body(changed.name))
          changed.type = world_.body(id).type;
        attempt([&] { world_.set_body(id, changed); });
        break;
      }
      case 5: {
        const BodyId id = body();
        attempt([&, to = state()] { world_.set_state(id, to); });
        break;
      }
      case 6:
      case 7:
      case 8: {
        const Joint joint = new_joint();
        if (world_.joint_ids().size() < kMostJoints)
          attempt([&, broken = below(10) == 0] { world_.add_joint(joint, broken); });
        break;
      }
      case 9:
        attempt([&, id = joint()] { world_.remove_joint(id); });
        break;
      case 10: {
        const JointId id = joint();
        attempt([&, to = motor()] { world_.set_motor(id, to); });
        break;
      }
      case 11: {
        const JointId id = joint();
        const int coordinate = below(5) - 1;
        std::optional<Motor> to;
        if (flag()) to = coordinate_motor();
        attempt([&] { world_.set_motor(id, coordinate, to); });
        break;
      }
      case 12: {
        const JointId id = joint();
        const int coordinate = below(5) - 1;
        attempt([&, to = law()] { world_.set_law(id, coordinate, to); });
        break;
      }
      case 13: {
        const JointId id = joint();
        attempt([&] {
          Joint changed = world_.joint(id);
          set_settings(&changed);
          world_.set_joint(id, changed);
        });
        break;
      }
      case 14: {
        const JointId id = joint();
        attempt([&, to = flag()] { world_.set_broken(id, to); });
        break;
      }
      case 15: {
        const JointId id = joint();
        attempt([&, to = flag()] { world_.set_enabled(id, to); });
        break;
      }
      case 16: {
        Wrench wrench;
        wrench.body = body();
        wrench.force = vector();
        if (flag()) wrench.torque = vector();
        wrench.start = flag() ? world_.time() : number();
        if (flag()) wrench.end = wrench.start + number();
        attempt([&] { world_.add_wrench(wrench); });
        break;
      }
      case 17:
        attempt([&, id = body()] { world_.clear_wrenches(id); });
        break;
      case 18: {
        WorldOptions options = world_.options();
        set_options(&options);
        attempt([&] { world_.set_options(options); });
        break;
      }
      case 19:
        if (flag())
          attempt([&] { world_.reset(); });
        else
          attempt(
              [&, t = number()] { world_.set_time(t, data_.ConsumeIntegral<std::uint16_t>()); });
        break;
      case 20:
        copy();
        break;
      case 21:
        if (hashes_) fuzz::check_snapshot(world_, &hash_);
        if (flag()) world_ = read_snapshot(write_snapshot(world_));  // has an equal hash
        break;
      case 22:
        ask();
        break;
      default:
        for (int k = below(4); k >= 0; --k) step(&world_, &hash_);
    }
  }

  /// Checks that a copy continues with the same bits, and that queries change nothing.
  void copy() {
    World other = world_;
    fuzz::KnownHash other_hash;
    if (hashes_) fuzz::require(other_hash.of(other) == hash_.of(world_), "a copy has another hash");
    World looked;
    world_.take_snapshot(&looked);
    const int stopped_before = stopped_steps_;
    step(&other, &other_hash);
    step(&world_, &hash_);
    if (stopped_steps_ == stopped_before)
      fuzz::require(other_hash.of(other) == hash_.of(world_), "a copy does not go on as its world");
    if (below(4) > 0) return;
    try {
      other.continue_from(world_);
    } catch (const std::invalid_argument&) {  // each of these calls doubles the ids of the copy
      fuzz::require(other_hash.of(other) == other.state_hash(),
                    "a world that got no ids has changed");
      return;
    }
    other.reserve_ids(world_);
    world_ = std::move(other);
    hash_.forget();
  }

  void ask() {
    const std::uint64_t before = hashes_ ? hash_.of(world_) : 0;
    explain(world_);
    left_out(world_);
    doubtful_settings(world_);
    world_.warnings();
    world_.islands();
    world_.energy();
    world_.unresolved_bodies();
    world_.unclosed_joints();
    for (const JointId id : world_.joint_ids()) {
      world_.anchors(id);
      text_of_opening(world_, id);
      if (!info(world_.joint(id).kind).couples_joints) world_.joint_wrench(id);
    }
    if (saves_) fuzz::check_saved(world_);
    fuzz::require(!hashes_ || world_.state_hash() == before, "a question has changed the world");
  }

  const std::uint64_t digest_;
  const bool hashes_ = fuzz::is_one_of(8, digest_ / 64);  // around each edit and question
  const bool saves_ = fuzz::is_one_of(16, digest_ / 1024);
  int stopped_steps_ = 0;
  FuzzedDataProvider data_;
  World world_;
  fuzz::KnownHash hash_;
};

}  // namespace

extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv) {
  fuzz::initialize(*argc, *argv);
  example_types::register_all();
  register_custom_force("fuzz/power", [](const CustomParameters& parameters) {
    return std::make_shared<PowerForce>(100.0 * example_types::parameter(parameters, "exponent"));
  });
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const fuzz::TimeLimit limit;
  Editor(data, size).run();
  return 0;
}
