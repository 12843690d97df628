// needs: pkg-config ode
//
// ODE: Cartesian coordinates, rods as distance balls; the direct solver with and without its
// default constraint force mixing, and quickstep.

#include <ode/ode.h>

#include <cmath>

#include "../contestant.h"

namespace constraint_sim::report {
namespace {

using Eigen::Vector3d;

/// ODE wants an inertia of point masses too; rods at their centres do not turn them.
constexpr double kAnyInertia = 0.01;  // [m²] of mass
constexpr int kMostContacts = 8;      // of a pair

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
    if (!problem.has_shapes()) return;
    space_ = dHashSpaceCreate(nullptr);
    contacts_ = dJointGroupCreate(0);
    for (std::size_t i = 0; i < problem.bodies.size(); ++i) add_shape(i);
  }

  ~OdeSimulation() override {
    if (contacts_ != nullptr) dJointGroupDestroy(contacts_);
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
      if (is_quick_)
        dWorldQuickStep(world_, tick_);
      else
        dWorldStep(world_, tick_);
      if (contacts_ != nullptr) dJointGroupEmpty(contacts_);
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
    if (joint.max_force != 0.0) throw Unsupported("motors with a force limit");
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
    const dJointID rod = dJointCreateDBall(world_, nullptr);
    dJointAttach(rod, b, a);
    dJointSetDBallAnchor1(rod, p_b.x(), p_b.y(), p_b.z());
    dJointSetDBallAnchor2(rod, p_a.x(), p_a.y(), p_a.z());
    const double length = joint.length >= 0.0 ? joint.length : (p_b - p_a).norm();
    dJointSetDBallDistance(rod, length);
    if (joint.rate != 0.0) motors_.push_back({rod, length, joint.rate});
    if (joint.kind == JointKind::kSpring) {  // ODE manual: ERP = hk / (hk + c), CFM = 1 / (hk + c)
      dJointSetDBallParam(rod, dParamERP, 1.0);
      dJointSetDBallParam(rod, dParamCFM, 1.0 / (tick_ * joint.stiffness));
    }
  }

  /// ODE's first body is B, as with all joints here.
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
    } else if (joint.kind == JointKind::kSlider) {
      dJointSetSliderAxis(attached(dJointCreateSlider(world_, nullptr)), z_a.x(), z_a.y(), z_a.z());
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
