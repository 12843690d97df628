// needs: pkg-config simbody
//
// Simbody: error-controlled Runge-Kutta-Merson; rods as constraints between bodies in Cartesian
// coordinates, or pins and balls in joint coordinates, where gears and racks are couplers and
// screws joints. Contacts are compliant: Hertz's, and a penalty at the corners of boxes. One-sided
// elements use event handlers. Its stepper with rigid contacts and impulses is left out: as built
// by Debian it prints pages each step.

#include <Simbody.h>

#include "../tree.h"
#include "rotation_between.h"
#include "simbody_laws.h"

namespace constraint_sim::report {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr double kDefaultAccuracy = 1e-3;
constexpr double kStiffness = 1e8;         // sinkage of a ball of 1 kg at rest about 10 µm [Pa]
constexpr double kDissipation = 10.0;      // no bounce above 0.1 m/s [s/m]
constexpr double kTransitionSpeed = 1e-3;  // sliding below it counts as sticking [m/s]

struct Contacts {
  explicit Contacts(SimTK::MultibodySystem* system) : tracker(*system), forces(*system, tracker) {
    forces.setTransitionVelocity(kTransitionSpeed);
  }
  SimTK::ContactTrackerSubsystem tracker;
  SimTK::CompliantContactSubsystem forces;
};

SimTK::Vec3 vec(const Vector3d& v) { return {v.x(), v.y(), v.z()}; }
Vector3d from(const SimTK::Vec3& v) { return {v[0], v[1], v[2]}; }
SimTK::Rotation rotation(const Quaterniond& q) {
  return SimTK::Rotation(SimTK::Quaternion(SimTK::Vec4(q.w(), q.x(), q.y(), q.z())));
}

class SimbodySimulation : public Simulation {
 public:
  SimbodySimulation(const Problem& problem, const Variant& variant, double tick, double accuracy)
      : problem_(problem), tick_(tick), matter_(system_), forces_(system_), integrator_(system_) {
    if (problem.has_shapes()) {
      check_shapes();
      contacts_ = std::make_unique<Contacts>(&system_);
    }
    SimTK::Force::UniformGravity(forces_, matter_, vec(problem.gravity));
    bodies_.resize(problem.bodies.size());
    centres_.assign(bodies_.size(), Vector3d::Zero());
    if (variant.has_joint_coordinates)
      add_tree();
    else
      add_bodies();
    for (std::size_t i = 0; i < bodies_.size(); ++i)
      if (!problem.bodies[i].force.isZero(0.0))
        SimTK::Force::ConstantForce(forces_, bodies_[i], SimTK::Vec3(0),
                                    vec(problem.bodies[i].force));
    add_springs_and_ropes();
    SimTK::State state = system_.realizeTopology();
    system_.realizeModel(state);
    if (variant.has_joint_coordinates)
      start_tree(&state);
    else
      start_bodies(&state);
    integrator_.setAccuracy(accuracy);
    if (laws_.empty()) {
      integrator_.initialize(state);
      return;
    }
    laws_.settle(&state);
    stepper_ = std::make_unique<SimTK::TimeStepper>(system_, integrator_);
    stepper_->initialize(state);
  }

  /// Advances by ticks. Steps are as long as the accuracy permits, and end on ticks.
  void advance(long ticks, double time) override {
    for (long i = ticks - 1; i >= 0; --i) {
      const double end = time - static_cast<double>(i) * tick_;
      if (stepper_ != nullptr)
        stepper_->stepTo(end);
      else
        while (integrator_.getTime() < end) integrator_.stepTo(end);
    }
  }

  void read(States* states) const override {
    const SimTK::State& state = integrator_.getState();
    system_.realize(state, SimTK::Stage::Velocity);
    states->clear();
    for (const SimTK::MobilizedBody& body : bodies_) {
      const SimTK::Quaternion q = body.getBodyRotation(state).convertRotationToQuaternion();
      const SimTK::Vec3 centre = body.getBodyMassCenterStation(state);
      states->push_back({from(body.findStationLocationInGround(state, centre)),
                         Quaterniond(q[0], q[1], q[2], q[3]),
                         from(body.findStationVelocityInGround(state, centre)),
                         from(body.getBodyAngularVelocity(state))});
    }
  }

 private:
  SimTK::MobilizedBody& body(int i) {
    return i == kWorld ? matter_.updGround() : bodies_[static_cast<std::size_t>(i)];
  }

  /// Checks shapes. Simbody has contacts of a box with a half-space only, and takes the harmonic
  /// mean of two frictions.
  void check_shapes() const {
    int boxes = 0, round = 0;
    for (const Body& body : problem_.bodies) {
      if (body.shape == Shape::kBox) ++boxes;
      if (body.shape == Shape::kSphere) ++round;
      if (body.friction != problem_.bodies.front().friction)
        throw Unsupported("friction by the geometric mean");
    }
    if (boxes > 0 && boxes + round > 1) throw Unsupported("boxes in contact with more than planes");
  }

  /// Returns a body whose centre of mass is at `centre` in its frame.
  SimTK::Body::Rigid rigid(const Body& body, const Vector3d& centre) const {
    const Vector3d I = inertia_of(problem_, body);
    const double mass = body.is_static ? 1.0 : body.mass;
    const SimTK::Inertia inertia =
        SimTK::Inertia(I.x(), I.y(), I.z()).shiftFromMassCenter(-vec(centre), mass);
    SimTK::Body::Rigid made(SimTK::MassProperties(mass, vec(centre), inertia));
    const SimTK::ContactMaterial material(kStiffness, kDissipation * (1.0 - body.restitution),
                                          body.friction, body.friction, 0.0);
    const auto add_surface = [&](const SimTK::ContactGeometry& shape, const SimTK::Rotation& turn) {
      made.addContactSurface(SimTK::Transform(turn, vec(centre)),
                             SimTK::ContactSurface(shape, material));
    };
    if (body.shape == Shape::kSphere)
      add_surface(SimTK::ContactGeometry::Sphere(body.size.x()), SimTK::Rotation());
    else if (body.shape == Shape::kBox)
      add_surface(SimTK::ContactGeometry::Brick(vec(body.size / 2.0)), SimTK::Rotation());
    else if (body.shape == Shape::kPlane)  // a half-space is solid along its x axis
      add_surface(SimTK::ContactGeometry::HalfSpace(),
                  SimTK::Rotation(SimTK::Pi / 2.0, SimTK::YAxis));
    return made;
  }

  SimTK::MobilizedBody fixed(const Body& body) {
    return SimTK::MobilizedBody::Weld(
        matter_.updGround(),
        SimTK::Transform(rotation(body.start.orientation), vec(body.start.position)),
        rigid(body, Vector3d::Zero()), SimTK::Transform());
  }

  void add_bodies() {
    check_without_axes(problem_);
    for (std::size_t i = 0; i < bodies_.size(); ++i) {
      const Body& added = problem_.bodies[i];
      if (added.is_static)
        bodies_[i] = fixed(added);
      else if (added.inertia.isZero(0.0))
        bodies_[i] =
            SimTK::MobilizedBody::Cartesian(matter_.updGround(), SimTK::Transform(),
                                            rigid(added, Vector3d::Zero()), SimTK::Transform());
      else
        bodies_[i] =
            SimTK::MobilizedBody::Free(matter_.updGround(), rigid(added, Vector3d::Zero()));
    }
    for (const Joint& joint : problem_.joints) {
      if (joint.kind == JointKind::kBall) {
        SimTK::Constraint::Ball(body(joint.a), vec(joint.anchor_a), body(joint.b),
                                vec(joint.anchor_b));
      } else if (joint.kind == JointKind::kRod) {
        if (joint.rate != 0.0) throw Unsupported("motors of rods");
        SimTK::Constraint::Rod rod(body(joint.a), vec(joint.anchor_a), body(joint.b),
                                   vec(joint.anchor_b), length_of(joint));
        if (joint.break_force > 0.0)
          add(std::make_unique<SimbodyBreaking>(matter_, rod, joint.break_force));
      }
    }
  }

  void add(std::unique_ptr<SimbodyLaw> law) { laws_.add(std::move(law), &system_); }

  /// Returns an anchor in the frame of the mobilized body.
  SimTK::Vec3 station(int i, const Vector3d& anchor) const {
    return vec(i == kWorld ? anchor : anchor + centres_[static_cast<std::size_t>(i)]);
  }

  void add_springs_and_ropes() {
    for (const Joint& joint : problem_.joints) {
      if (joint.kind == JointKind::kSpring)
        SimTK::Force::TwoPointLinearSpring(forces_, body(joint.a), station(joint.a, joint.anchor_a),
                                           body(joint.b), station(joint.b, joint.anchor_b),
                                           joint.stiffness, length_of(joint));
      else if (joint.is_rope())
        add_rope(joint);
      else if (joint.kind == JointKind::kFreeLength)
        throw Unsupported("pulleys");
    }
  }

  void add_rope(const Joint& rope) {
    if (rope.rate != 0.0) throw Unsupported("winches");
    SimTK::MobilizedBody& a = body(rope.a);
    SimTK::MobilizedBody& b = body(rope.b);
    const SimTK::Vec3 at_a = station(rope.a, rope.anchor_a), at_b = station(rope.b, rope.anchor_b);
    SimTK::Constraint::Rod taut(a, at_a, b, at_b, rope.upper);
    taut.setDisabledByDefault(true);
    const auto along = [=](const SimTK::State& state) {
      return b.findStationLocationInGround(state, at_b) -
             a.findStationLocationInGround(state, at_a);
    };
    const auto gap = [=](const SimTK::State& state) { return rope.upper - along(state).norm(); };
    const auto rate = [=](const SimTK::State& state) {
      const SimTK::Vec3 speed =
          b.findStationVelocityInGround(state, at_b) - a.findStationVelocityInGround(state, at_a);
      return -dot(SimTK::UnitVec3(along(state)), speed);
    };
    add(std::make_unique<SimbodyStop>(matter_, taut, SimbodyStop::Gap{gap, rate, 1.0},
                                      rope.restitution));
  }

  /// Adds the laws of the coordinate by which body `i` hangs.
  void add_laws(const Joint& joint, std::size_t i) {
    SimTK::MobilizedBody hung = bodies_[i];
    const SimTK::MobilizerQIndex q(0);
    for (const double side : {1.0, -1.0}) {
      const double limit = side > 0.0 ? joint.upper : joint.lower;
      if (!std::isfinite(limit)) continue;
      SimTK::Constraint::ConstantCoordinate there(hung, q, limit);
      there.setDisabledByDefault(true);
      const auto gap = [=](const SimTK::State& state) {
        return side * (limit - hung.getOneQ(state, 0));
      };
      const auto rate = [=](const SimTK::State& state) { return -side * hung.getOneU(state, 0); };
      add(std::make_unique<SimbodyStop>(matter_, there, SimbodyStop::Gap{gap, rate, side},
                                        joint.restitution));
    }
    if (joint.friction > 0.0)
      add(std::make_unique<SimbodyDrive>(&matter_, &forces_, &hung, 0.0, joint.friction));
    if (joint.max_force > 0.0)
      add(std::make_unique<SimbodyDrive>(&matter_, &forces_, &hung, joint.rate, joint.max_force));
  }

  double length_of(const Joint& joint) const {
    const auto in_world = [&](int i, const Vector3d& anchor) -> Vector3d {
      if (i == kWorld) return anchor;
      const State& start = problem_.bodies[static_cast<std::size_t>(i)].start;
      return start.position + start.orientation * anchor;
    };
    if (joint.length >= 0.0) return joint.length;
    return (in_world(joint.b, joint.anchor_b) - in_world(joint.a, joint.anchor_a)).norm();
  }

  void start_bodies(SimTK::State* state) {
    for (std::size_t i = 0; i < bodies_.size(); ++i) place(i, state);
    system_.realize(*state, SimTK::Stage::Position);
    for (std::size_t i = 0; i < bodies_.size(); ++i) set_velocity(i, state);
  }

  /// Sets the pose of a body that hangs on no joint.
  void place(std::size_t i, SimTK::State* state) {
    const Body& body = problem_.bodies[i];
    if (body.is_static) return;
    if (!body.inertia.isZero(0.0))
      bodies_[i].setQToFitRotation(*state, rotation(body.start.orientation));
    bodies_[i].setQToFitTranslation(*state, vec(body.start.position));
  }

  void set_velocity(std::size_t i, SimTK::State* state) {
    const Body& body = problem_.bodies[i];
    if (body.is_static) return;
    if (!body.inertia.isZero(0.0))
      bodies_[i].setUToFitAngularVelocity(*state, vec(body.start.angular_velocity));
    bodies_[i].setUToFitLinearVelocity(*state, vec(body.start.velocity));
  }

  void add_tree() {
    tree_ = tree_of(problem_, nullptr, true);
    // Pins turn about z, hinges of planar problems about y.
    const SimTK::Rotation axis =
        problem_.is_planar ? SimTK::Rotation(-SimTK::Pi / 2.0, SimTK::XAxis) : SimTK::Rotation();
    for (const Link& link : tree_) {
      const auto i = static_cast<std::size_t>(link.body);
      const Body& added = problem_.bodies[i];
      centres_[i] = link.centre;
      if (added.is_static) {
        bodies_[i] = fixed(added);
        continue;
      }
      if (!link.is_hung) {
        if (added.inertia.isZero(0.0))
          bodies_[i] =
              SimTK::MobilizedBody::Cartesian(matter_.updGround(), SimTK::Transform(),
                                              rigid(added, link.centre), SimTK::Transform());
        else
          bodies_[i] = SimTK::MobilizedBody::Free(matter_.updGround(), rigid(added, link.centre));
        continue;
      }
      Vector3d at = link.anchor;
      Quaterniond turn = added.start.orientation;
      if (link.parent != kWorld) {
        const auto parent = static_cast<std::size_t>(link.parent);
        at += centres_[parent];
        turn = problem_.bodies[parent].start.orientation.conjugate() * turn;
      }
      if (link.joint != nullptr) {
        add_on_axes(link, at, i);
        add_laws(*link.joint, i);
        continue;
      }
      const SimTK::Transform in_parent(rotation(turn) * axis, vec(at)),
          in_child(axis, SimTK::Vec3(0));
      if (problem_.is_planar)
        bodies_[i] = SimTK::MobilizedBody::Pin(body(link.parent), in_parent,
                                               rigid(added, link.centre), in_child);
      else
        bodies_[i] = SimTK::MobilizedBody::Ball(body(link.parent), in_parent,
                                                rigid(added, link.centre), in_child);
    }
    for (const Coupling& coupling : problem_.couplings)
      if (!coupling.is_screw()) couple(coupling);
  }

  /// Couples the single coordinates of two bodies, both zero at the start.
  void couple(const Coupling& coupling) {
    const auto body_of = [&](int joint) {
      const Joint& of = problem_.joints[static_cast<std::size_t>(joint)];
      return body(of.b).getMobilizedBodyIndex();
    };
    SimTK::Vector coefficients(3);
    coefficients[0] = 1.0;
    coefficients[1] = coupling.ratio;
    coefficients[2] = 0.0;
    SimTK::Array_<SimTK::MobilizedBodyIndex> bodies;
    bodies.push_back(body_of(coupling.first));
    bodies.push_back(body_of(coupling.second));
    SimTK::Constraint::CoordinateCoupler(
        matter_, new SimTK::Function::Linear(coefficients), bodies,
        SimTK::Array_<SimTK::MobilizerQIndex>(2, SimTK::MobilizerQIndex(0)));
  }

  /// Adds a body on a joint with axes. Sliders move along x; universal joints turn about x of the
  /// parent's frame, then y of the child's; other joints use z, as problems do.
  void add_on_axes(const Link& link, const Vector3d& at, std::size_t i) {
    const Joint& joint = *link.joint;
    Quaterniond on_parent = joint.frame_a, on_child = joint.frame_b;
    if (joint.kind == JointKind::kSlider) {
      const Quaterniond x_to_z = rotation_between(Vector3d::UnitX(), Vector3d::UnitZ());
      on_parent = on_parent * x_to_z;
      on_child = on_child * x_to_z;
    } else if (joint.kind == JointKind::kUniversal) {  // frames that coincide at the start
      const auto in_world = [&](int k) {
        return k == kWorld ? Quaterniond::Identity()
                           : problem_.bodies[static_cast<std::size_t>(k)].start.orientation;
      };
      const Vector3d x = in_world(joint.a) * joint.frame_a * Vector3d::UnitZ();
      const Vector3d y = in_world(joint.b) * joint.frame_b * Vector3d::UnitZ();
      Eigen::Matrix3d axes;
      axes << x, y, x.cross(y);
      on_parent = in_world(joint.a).conjugate() * Quaterniond(axes);
      on_child = in_world(joint.b).conjugate() * Quaterniond(axes);
    }
    const SimTK::Transform in_parent(rotation(on_parent), vec(at)),
        in_child(rotation(on_child), SimTK::Vec3(0));
    SimTK::MobilizedBody& parent = body(link.parent);
    const SimTK::Body::Rigid made = rigid(problem_.bodies[i], link.centre);
    const auto k = static_cast<std::size_t>(&joint - problem_.joints.data());
    if (const Coupling* screw = problem_.screw_of(k)) {
      bodies_[i] = SimTK::MobilizedBody::Screw(parent, in_parent, made, in_child,
                                               screw->pitch() / (2.0 * SimTK::Pi));
      return;
    }
    switch (joint.kind) {
      case JointKind::kHinge:
        bodies_[i] = SimTK::MobilizedBody::Pin(parent, in_parent, made, in_child);
        break;
      case JointKind::kSlider:
        bodies_[i] = SimTK::MobilizedBody::Slider(parent, in_parent, made, in_child);
        break;
      case JointKind::kCylindrical:
        bodies_[i] = SimTK::MobilizedBody::Cylinder(parent, in_parent, made, in_child);
        break;
      case JointKind::kPlanar:
        bodies_[i] = SimTK::MobilizedBody::Planar(parent, in_parent, made, in_child);
        break;
      case JointKind::kUniversal:
        bodies_[i] = SimTK::MobilizedBody::Universal(parent, in_parent, made, in_child);
        break;
      case JointKind::kWeld:
        bodies_[i] = SimTK::MobilizedBody::Weld(parent, in_parent, made, in_child);
        break;
      default:
        throw Unsupported(name(joint.kind));
    }
  }

  void start_tree(SimTK::State* state) {
    for (const Link& link : tree_)  // joints start at zero
      if (!link.is_hung) place(static_cast<std::size_t>(link.body), state);
    system_.realize(*state, SimTK::Stage::Position);
    std::vector<Vector3d> spins(bodies_.size(), Vector3d::Zero());
    for (const Link& link : tree_) {
      const auto i = static_cast<std::size_t>(link.body);
      const State& start = problem_.bodies[i].start;
      spins[i] = start_spin(problem_, link);
      if (link.joint != nullptr) {
        if (link.rate != 0.0) bodies_[i].setOneU(*state, 0, link.rate);
        continue;
      }
      if (!link.is_hung) {
        set_velocity(i, state);
        continue;
      }
      Vector3d spin = spins[i];
      if (link.parent != kWorld) spin -= spins[static_cast<std::size_t>(link.parent)];
      if (problem_.is_planar) {
        bodies_[i].setOneU(*state, 0, spin.y());
      } else {
        // The speeds of a ball are its angular velocity in the frame on the parent.
        const Vector3d local = start.orientation.conjugate() * spin;
        for (int k = 0; k < 3; ++k) bodies_[i].setOneU(*state, k, local[k]);
      }
    }
  }

  const Problem& problem_;
  double tick_;
  SimTK::MultibodySystem system_;
  SimTK::SimbodyMatterSubsystem matter_;
  SimTK::GeneralForceSubsystem forces_;
  std::unique_ptr<Contacts> contacts_;
  SimTK::RungeKuttaMersonIntegrator integrator_;
  SimbodyLaws laws_;
  std::unique_ptr<SimTK::TimeStepper> stepper_;  // exists where there are laws
  std::vector<SimTK::MobilizedBody> bodies_;
  std::vector<Vector3d> centres_;  // centres of mass in the bodies' frames
  std::vector<Link> tree_;
};

}  // namespace

std::string Contestant::name() { return "simbody"; }
std::string Contestant::version() { return CONSTRAINT_SIM_PEER_VERSION; }

std::vector<Variant> Contestant::variants() {
  std::vector<double> accuracies;
  for (double accuracy = 1e-1; accuracy > 3e-12; accuracy *= 0.1) accuracies.push_back(accuracy);
  return {{"rod", false, Knob::kTolerance, accuracies},
          {"pin", true, Knob::kTolerance, accuracies}};
}

std::unique_ptr<Simulation> Contestant::make(const Problem& problem, const Variant& variant,
                                             const Setting& setting) {
  return std::make_unique<SimbodySimulation>(
      problem, variant, setting.tick,
      setting.tolerance > 0.0 ? setting.tolerance : kDefaultAccuracy);
}

}  // namespace constraint_sim::report
