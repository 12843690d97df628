// needs: pkg-config ode
//
// ODE: Cartesian coordinates, rods as distance balls; the direct solver with and without its
// default constraint force mixing, and quickstep. Stops bounce and motors have a largest force, as
// in the manual; friction of a joint is a motor of rate 0. A rope is a contact that pulls when
// taut, a winch a linear motor along the rope.

#include <ode/ode.h>

#include <cmath>

#include "../contestant.h"

namespace constraint_sim::report {
namespace {

using Eigen::Vector3d;

/// Inertia of point masses, which ODE requires; rods at their centres do not rotate them.
constexpr double kAnyInertia = 0.01;  // inertia over mass [m²]
constexpr int kMostContacts = 8;      // contacts per pair

struct Library {
  Library() { dInitODE2(0); }
  ~Library() { dCloseODE(); }
};

class OdeSimulation : public Simulation {
 public:
  OdeSimulation(const Problem& problem, const std::string& variant, double tick)
      : problem_(problem), tick_(tick), world_(dWorldCreate()) {
    check_without_couplings(problem);
    dWorldSetGravity(world_, problem.gravity.x(), problem.gravity.y(), problem.gravity.z());
    if (variant == "step_cfm_0") dWorldSetCFM(world_, 0.0);
    const std::string quick = "quickstep_";
    if (variant.rfind(quick, 0) == 0) {
      is_quick_ = true;
      dWorldSetQuickStepNumIterations(world_, std::stoi(variant.substr(quick.size())));
    }
    for (const Body& body : problem.bodies) bodies_.push_back(add(body));
    for (const Joint& joint : problem.joints) add(joint);
    contacts_ = dJointGroupCreate(0);
    if (!problem.has_shapes()) return;
    space_ = dHashSpaceCreate(nullptr);
    for (std::size_t i = 0; i < problem.bodies.size(); ++i) add_shape(i);
  }

  ~OdeSimulation() override {
    dJointGroupDestroy(contacts_);
    if (space_ != nullptr) dSpaceDestroy(space_);
    dWorldDestroy(world_);
  }

  void advance(long ticks, double) override {
    for (long i = 0; i < ticks; ++i) {
      time_ += tick_;
      for (const Motor& motor : motors_)
        dJointSetDBallDistance(motor.joint, motor.length + motor.rate * time_);
      for (std::size_t k = 0; k < bodies_.size(); ++k) {
        const Vector3d& f = problem_.bodies[k].force;
        if (!f.isZero(0.0)) dBodyAddForce(bodies_[k], f.x(), f.y(), f.z());
      }
      if (space_ != nullptr) dSpaceCollide(space_, this, &collide);
      for (Breaking& rod : breaking_)
        if (rod.joint != nullptr) dJointSetFeedback(rod.joint, &rod.feedback);
      for (const Joint* rope : ropes_) pull(*rope);
      for (const Winch& winch : winches_) set_axis(winch);
      if (is_quick_)
        dWorldQuickStep(world_, tick_);
      else
        dWorldStep(world_, tick_);
      dJointGroupEmpty(contacts_);
      for (Breaking& rod : breaking_) break_beyond(&rod);
    }
  }

  void read(States* states) const override {
    states->clear();
    for (std::size_t i = 0; i < bodies_.size(); ++i) {
      if (bodies_[i] == nullptr) {
        states->push_back(problem_.bodies[i].start);
        continue;
      }
      const dReal* q = dBodyGetQuaternion(bodies_[i]);
      State state;
      state.position = vector(dBodyGetPosition(bodies_[i]));
      state.orientation = Eigen::Quaterniond(q[0], q[1], q[2], q[3]);
      state.velocity = vector(dBodyGetLinearVel(bodies_[i]));
      state.angular_velocity = vector(dBodyGetAngularVel(bodies_[i]));
      states->push_back(state);
    }
  }

 private:
  struct Motor {
    dJointID joint;
    double length, rate;
  };
  struct Winch {
    dJointID motor;
    const Joint* rope;
  };
  struct Breaking {
    dJointID joint;
    double force;
    dJointFeedback feedback{};
  };

  static Vector3d vector(const dReal* x) { return {x[0], x[1], x[2]}; }

  dBodyID add(const Body& body) {
    if (body.is_static) return nullptr;
    const dBodyID id = dBodyCreate(world_);
    const State& start = body.start;
    const Vector3d inertia = body.inertia.isZero(0.0)
                                 ? Vector3d(Vector3d::Constant(kAnyInertia * body.mass))
                                 : body.inertia;
    dMass mass;
    dMassSetParameters(&mass, body.mass, 0, 0, 0, inertia.x(), inertia.y(), inertia.z(), 0, 0, 0);
    dBodySetMass(id, &mass);
    const Eigen::Quaterniond& q = start.orientation;
    const dQuaternion turn = {q.w(), q.x(), q.y(), q.z()};
    dBodySetPosition(id, start.position.x(), start.position.y(), start.position.z());
    dBodySetQuaternion(id, turn);
    dBodySetLinearVel(id, start.velocity.x(), start.velocity.y(), start.velocity.z());
    dBodySetAngularVel(id, start.angular_velocity.x(), start.angular_velocity.y(),
                       start.angular_velocity.z());
    return id;
  }

  Vector3d in_world(int body, const Vector3d& anchor) const {
    if (body == kWorld) return anchor;
    const State& start = problem_.bodies[static_cast<std::size_t>(body)].start;
    return start.position + start.orientation * anchor;
  }

  void add(const Joint& joint) {
    if (joint.kind == JointKind::kRod && joint.max_force != 0.0)
      throw Unsupported("rods with a force limit");
    const dBodyID b = bodies_[static_cast<std::size_t>(joint.b)];
    const dBodyID a = joint.a == kWorld ? nullptr : bodies_[static_cast<std::size_t>(joint.a)];
    const Vector3d p_b = in_world(joint.b, joint.anchor_b);
    const Vector3d p_a = in_world(joint.a, joint.anchor_a);
    if (joint.kind == JointKind::kBall) {
      const dJointID ball = dJointCreateBall(world_, nullptr);
      dJointAttach(ball, b, a);
      dJointSetBallAnchor(ball, p_b.x(), p_b.y(), p_b.z());
      return;
    }
    if (has_axes(joint.kind)) return add_on_axes(joint, a, b, p_b);
    if (joint.kind == JointKind::kFreeLength) return add_rope(joint, b);
    const dJointID rod = dJointCreateDBall(world_, nullptr);
    dJointAttach(rod, b, a);
    dJointSetDBallAnchor1(rod, p_b.x(), p_b.y(), p_b.z());
    dJointSetDBallAnchor2(rod, p_a.x(), p_a.y(), p_a.z());
    const double length = joint.length >= 0.0 ? joint.length : (p_b - p_a).norm();
    dJointSetDBallDistance(rod, length);
    if (joint.rate != 0.0) motors_.push_back({rod, length, joint.rate});
    if (joint.break_force > 0.0) breaking_.push_back({rod, joint.break_force});
    if (joint.kind == JointKind::kSpring) {  // ODE manual: ERP = hk / (hk + c), CFM = 1 / (hk + c)
      dJointSetDBallParam(rod, dParamERP, 1.0);
      dJointSetDBallParam(rod, dParamCFM, 1.0 / (tick_ * joint.stiffness));
    }
  }

  void add_rope(const Joint& joint, dBodyID b) {
    if (joint.a != kWorld || !joint.anchor_b.isZero(0.0) || !joint.is_rope())
      throw Unsupported("ropes but from the world to the centre of a body");
    if (joint.max_force == 0.0) {
      ropes_.push_back(&joint);
      return;
    }
    if (joint.rate == 0.0) throw Unsupported("ropes that give way");
    const dJointID motor = dJointCreateLMotor(world_, nullptr);
    dJointAttach(motor, b, nullptr);
    dJointSetLMotorNumAxes(motor, 1);
    dJointSetLMotorParam(motor, dParamVel, joint.rate);
    dJointSetLMotorParam(motor, dParamFMax, joint.max_force);
    winches_.push_back({motor, &joint});
  }

  /// Returns the vector from the anchor to the body.
  Vector3d along(const Joint& rope) const {
    return vector(dBodyGetPosition(bodies_[static_cast<std::size_t>(rope.b)])) - rope.anchor_a;
  }

  void set_axis(const Winch& winch) {
    const Vector3d d = along(*winch.rope).normalized();
    dJointSetLMotorAxis(winch.motor, 0, 0, d.x(), d.y(), d.z());
  }

  void pull(const Joint& rope) {
    const Vector3d d = along(rope), x = rope.anchor_a + d, n = -d.normalized();
    if (d.norm() < rope.upper) return;
    dContact contact{};
    contact.surface.mode = dContactBounce;
    contact.surface.bounce = rope.restitution;
    contact.geom.depth = d.norm() - rope.upper;
    for (int k = 0; k < 3; ++k) {
      contact.geom.pos[k] = x[k];
      contact.geom.normal[k] = n[k];
    }
    dJointAttach(dJointCreateContact(world_, contacts_, &contact),
                 bodies_[static_cast<std::size_t>(rope.b)], nullptr);
  }

  void break_beyond(Breaking* rod) const {
    if (rod->joint == nullptr || !(vector(rod->feedback.f1).norm() > rod->force)) return;
    dJointDestroy(rod->joint);
    rod->joint = nullptr;
  }

  /// Sets limits, friction and motor of a hinge or slider; an ODE motor has one rate and one force.
  template <class Set>
  static void add_law(const Joint& joint, const Set& set) {
    if (joint.friction > 0.0 && joint.max_force > 0.0) throw Unsupported("a motor with friction");
    if (std::isfinite(joint.lower)) set(dParamLoStop, joint.lower);
    if (std::isfinite(joint.upper)) set(dParamHiStop, joint.upper);
    set(dParamBounce, joint.restitution);
    set(dParamVel, joint.rate);
    set(dParamFMax, joint.friction + joint.max_force);
  }

  /// Adds a joint with axes. ODE's first body is B, as in all joints here.
  void add_on_axes(const Joint& joint, dBodyID a, dBodyID b, const Vector3d& p) {
    const auto in_world = [&](int i) {
      return i == kWorld ? Eigen::Quaterniond::Identity()
                         : problem_.bodies[static_cast<std::size_t>(i)].start.orientation;
    };
    const Vector3d z_a = in_world(joint.a) * joint.frame_a * Vector3d::UnitZ();
    const Vector3d z_b = in_world(joint.b) * joint.frame_b * Vector3d::UnitZ();
    const auto attached = [&](dJointID made) {
      dJointAttach(made, b, a);
      return made;
    };
    if (joint.kind == JointKind::kHinge) {
      const dJointID hinge = attached(dJointCreateHinge(world_, nullptr));
      dJointSetHingeAnchor(hinge, p.x(), p.y(), p.z());
      dJointSetHingeAxis(hinge, z_a.x(), z_a.y(), z_a.z());
      add_law(joint, [&](int name, double value) { dJointSetHingeParam(hinge, name, value); });
    } else if (joint.kind == JointKind::kSlider) {
      const dJointID slider = attached(dJointCreateSlider(world_, nullptr));
      dJointSetSliderAxis(slider, z_a.x(), z_a.y(), z_a.z());
      add_law(joint, [&](int name, double value) { dJointSetSliderParam(slider, name, value); });
    } else if (joint.kind == JointKind::kCylindrical) {
      const dJointID piston = attached(dJointCreatePiston(world_, nullptr));
      dJointSetPistonAnchor(piston, p.x(), p.y(), p.z());
      dJointSetPistonAxis(piston, z_a.x(), z_a.y(), z_a.z());
    } else if (joint.kind == JointKind::kUniversal) {
      const dJointID universal = attached(dJointCreateUniversal(world_, nullptr));
      dJointSetUniversalAnchor(universal, p.x(), p.y(), p.z());
      dJointSetUniversalAxis1(universal, z_b.x(), z_b.y(), z_b.z());
      dJointSetUniversalAxis2(universal, z_a.x(), z_a.y(), z_a.z());
    } else if (joint.kind == JointKind::kWeld) {
      dJointSetFixed(attached(dJointCreateFixed(world_, nullptr)));
    } else {
      throw Unsupported(name(joint.kind));
    }
  }

  void add_shape(std::size_t i) {
    const Body& body = problem_.bodies[i];
    const State& start = body.start;
    const Vector3d normal = start.orientation * Vector3d::UnitZ();
    dGeomID shape = nullptr;
    switch (body.shape) {
      case Shape::kPoint:
        return;
      case Shape::kSphere:
        shape = dCreateSphere(space_, body.size.x());
        break;
      case Shape::kBox:
        shape = dCreateBox(space_, body.size.x(), body.size.y(), body.size.z());
        break;
      case Shape::kPlane:
        shape =
            dCreatePlane(space_, normal.x(), normal.y(), normal.z(), normal.dot(start.position));
        break;
    }
    dGeomSetData(shape, const_cast<Body*>(&body));
    if (bodies_[i] != nullptr)
      dGeomSetBody(shape, bodies_[i]);
    else if (body.shape != Shape::kPlane)
      dGeomSetPosition(shape, start.position.x(), start.position.y(), start.position.z());
  }

  static void collide(void* self, dGeomID a, dGeomID b) {
    auto* simulation = static_cast<OdeSimulation*>(self);
    if (dGeomGetBody(a) == nullptr && dGeomGetBody(b) == nullptr) return;
    const auto& body_a = *static_cast<const Body*>(dGeomGetData(a));
    const auto& body_b = *static_cast<const Body*>(dGeomGetData(b));
    dContact contacts[kMostContacts];
    const int count = dCollide(a, b, kMostContacts, &contacts[0].geom, sizeof(dContact));
    for (int i = 0; i < count; ++i) {
      dSurfaceParameters& surface = contacts[i].surface;
      surface = {};
      surface.mode = dContactBounce | dContactApprox1;
      surface.mu = std::sqrt(body_a.friction * body_b.friction);
      surface.bounce = std::max(body_a.restitution, body_b.restitution);
      dJointAttach(dJointCreateContact(simulation->world_, simulation->contacts_, &contacts[i]),
                   dGeomGetBody(a), dGeomGetBody(b));
    }
  }

  const Problem& problem_;
  double tick_;
  double time_ = 0.0;
  bool is_quick_ = false;
  dWorldID world_;
  dSpaceID space_ = nullptr;
  dJointGroupID contacts_ = nullptr;
  std::vector<dBodyID> bodies_;
  std::vector<Motor> motors_;
  std::vector<const Joint*> ropes_;
  std::vector<Winch> winches_;
  std::vector<Breaking> breaking_;
};

}  // namespace

std::string Contestant::name() { return "ode"; }
std::string Contestant::version() { return CONSTRAINT_SIM_PEER_VERSION; }

std::vector<Variant> Contestant::variants() {
  return {{"step_cfm_0"}, {"step"}, {"quickstep_10"}, {"quickstep_50"}, {"quickstep_200"}};
}

std::unique_ptr<Simulation> Contestant::make(const Problem& problem, const Variant& variant,
                                             const Setting& setting) {
  static const Library kLibrary;
  return std::make_unique<OdeSimulation>(problem, variant.name, setting.tick);
}

}  // namespace constraint_sim::report
