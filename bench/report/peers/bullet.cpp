// needs: pkg-config bullet-float64
//
// Bullet in double precision: sequential impulses and Dantzig's solver in Cartesian coordinates,
// and Featherstone's articulated bodies with RK4 in joint coordinates, contacts by impulses. Hinges
// and sliders with stops and motors are Bullet's; friction of a joint is a motor of rate 0. Rods,
// ropes and winches are own constraints with one row, written like Bullet's.

#include <BulletDynamics/Featherstone/btMultiBody.h>
#include <BulletDynamics/Featherstone/btMultiBodyConstraintSolver.h>
#include <BulletDynamics/Featherstone/btMultiBodyDynamicsWorld.h>
#include <BulletDynamics/Featherstone/btMultiBodyLinkCollider.h>
#include <BulletDynamics/MLCPSolvers/btDantzigSolver.h>
#include <BulletDynamics/MLCPSolvers/btMLCPSolver.h>
#include <btBulletDynamicsCommon.h>

#include <cmath>

#include "../tree.h"
#include "rotation_between.h"

namespace constraint_sim::report {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr double kAnyInertia =
    0.01;  // inertia over mass of a point mass [m²]; rods at its centre do not rotate it

btVector3 to_bullet(const Vector3d& v) { return {v.x(), v.y(), v.z()}; }
btQuaternion to_bullet(const Quaterniond& q) { return {q.x(), q.y(), q.z(), q.w()}; }
Vector3d from_bullet(const btVector3& v) { return {v.x(), v.y(), v.z()}; }
Quaterniond from_bullet(const btQuaternion& q) { return {q.w(), q.x(), q.y(), q.z()}; }

/// A rod, which Bullet lacks: one row along the line between the anchors. A rope only pulls, and
/// its length may grow to its limit; a winch pulls with limited force.
class Rod : public btTypedConstraint {
 public:
  Rod(btRigidBody& a, btRigidBody& b, const Joint& joint, double length)
      : btTypedConstraint(MAX_CONSTRAINT_TYPE, a, b),
        anchor_a_(to_bullet(joint.anchor_a)),
        anchor_b_(to_bullet(joint.anchor_b)),
        length_(length),
        is_rope_(joint.is_rope()),
        restitution_(joint.restitution),
        rate_(joint.rate),
        most_(joint.max_force) {}

  void set_length(double length) { length_ = length; }

  void getInfo1(btConstraintInfo1* info) override {
    info->m_numConstraintRows = 1;
    info->nub = 5;
  }

  void getInfo2(btConstraintInfo2* info) override {
    const btVector3 r_a = m_rbA.getCenterOfMassTransform().getBasis() * anchor_a_;
    const btVector3 r_b = m_rbB.getCenterOfMassTransform().getBasis() * anchor_b_;
    const btVector3 d =
        m_rbB.getCenterOfMassPosition() + r_b - m_rbA.getCenterOfMassPosition() - r_a;
    const btScalar distance = d.length();
    const btVector3 n = d / distance, turn_a = -r_a.cross(n), turn_b = r_b.cross(n);
    for (int i = 0; i < 3; ++i) {
      info->m_J1linearAxis[i] = -n[i];
      info->m_J1angularAxis[i] = turn_a[i];
      info->m_J2linearAxis[i] = n[i];
      info->m_J2angularAxis[i] = turn_b[i];
    }
    const btScalar over = distance - length_;
    btScalar& rate = info->m_constraintError[0];
    rate = -info->erp * info->fps * over;
    info->m_lowerLimit[0] = -SIMD_INFINITY;
    info->m_upperLimit[0] = is_rope_ ? 0.0 : SIMD_INFINITY;
    if (most_ > 0.0) {
      rate = rate_;
      info->m_lowerLimit[0] = -most_ / info->fps;
    } else if (is_rope_) {
      const btScalar grows =
          n.dot(m_rbB.getVelocityInLocalPoint(r_b)) - n.dot(m_rbA.getVelocityInLocalPoint(r_a));
      if (over < 0.0) rate = -info->fps * over;
      if (restitution_ > 0.0 && over + grows / info->fps > 0.0)
        rate = btMin(rate, -restitution_ * grows);
    }
  }

  void setParam(int, btScalar, int) override {}
  btScalar getParam(int, int) const override { return 0.0; }

 private:
  btVector3 anchor_a_, anchor_b_;
  btScalar length_;
  bool is_rope_;
  btScalar restitution_, rate_, most_;
};

struct Collisions {
  btDefaultCollisionConfiguration configuration;
  btCollisionDispatcher dispatcher{&configuration};
  btDbvtBroadphase broadphase;
};

btTransform start_of(const Body& body) {
  return btTransform(to_bullet(body.start.orientation), to_bullet(body.start.position));
}

void set_surface(const Body& body, btCollisionObject* object) {
  // Bullet multiplies coefficients; a problem has the geometric mean for friction, and equal
  // restitution on all bodies.
  object->setFriction(std::sqrt(body.friction));
  object->setRestitution(std::sqrt(body.restitution));
}

class Shapes {
 public:
  btCollisionShape* add(const Body& body) {
    switch (body.shape) {
      case Shape::kPoint:
        shapes_.push_back(std::make_unique<btEmptyShape>());
        break;
      case Shape::kSphere:
        shapes_.push_back(std::make_unique<btSphereShape>(body.size.x()));
        break;
      case Shape::kBox:
        shapes_.push_back(std::make_unique<btBoxShape>(to_bullet(body.size / 2.0)));
        break;
      case Shape::kPlane:
        shapes_.push_back(std::make_unique<btStaticPlaneShape>(btVector3(0, 0, 1), 0.0));
        break;
    }
    return shapes_.back().get();
  }

 private:
  std::vector<std::unique_ptr<btCollisionShape>> shapes_;
};

class BulletSimulation : public Simulation {
 public:
  BulletSimulation(const Problem& problem, const std::string& variant, double tick)
      : problem_(problem), tick_(tick) {
    check_without_couplings(problem);
    const std::string impulses = "sequential_impulses_";
    if (variant == "dantzig")
      solver_ = std::make_unique<btMLCPSolver>(&dantzig_);
    else
      solver_ = std::make_unique<btSequentialImpulseConstraintSolver>();
    world_ =
        std::make_unique<btDiscreteDynamicsWorld>(&collisions_.dispatcher, &collisions_.broadphase,
                                                  solver_.get(), &collisions_.configuration);
    world_->setGravity(to_bullet(problem.gravity));
    if (variant == "dantzig")
      world_->getSolverInfo().m_minimumSolverBatchSize = 1;  // solves islands separately
    else
      world_->getSolverInfo().m_numIterations = std::stoi(variant.substr(impulses.size()));
    for (const Body& body : problem.bodies) add(body);
    for (const Joint& joint : problem.joints) add(joint);
  }

  ~BulletSimulation() override {
    for (const auto& joint : joints_) world_->removeConstraint(joint.get());
    for (const auto& body : bodies_) world_->removeRigidBody(body.get());
  }

  void advance(long ticks, double) override {
    for (long i = 0; i < ticks; ++i) {
      time_ += tick_;
      for (const Motor& motor : motors_) motor.rod->set_length(motor.length + motor.rate * time_);
      for (std::size_t k = 0; k < bodies_.size(); ++k)
        if (!problem_.bodies[k].force.isZero(0.0))
          bodies_[k]->applyCentralForce(to_bullet(problem_.bodies[k].force));
      world_->stepSimulation(tick_, 0);
    }
  }

  void read(States* states) const override {
    states->clear();
    for (const auto& body : bodies_)
      states->push_back(
          {from_bullet(body->getCenterOfMassPosition()), from_bullet(body->getOrientation()),
           from_bullet(body->getLinearVelocity()), from_bullet(body->getAngularVelocity())});
  }

 private:
  static constexpr double kFar =
      3.0;  // beyond the coordinates of problems [m or rad]; as an angle below π

  struct Motor {
    Rod* rod;
    double length, rate;
  };

  void add(const Body& body) {
    const Vector3d inertia = body.inertia.isZero(0.0)
                                 ? Vector3d(Vector3d::Constant(kAnyInertia * body.mass))
                                 : body.inertia;
    btRigidBody::btRigidBodyConstructionInfo info(body.is_static ? 0.0 : body.mass, nullptr,
                                                  shapes_.add(body), to_bullet(inertia));
    info.m_startWorldTransform = start_of(body);
    bodies_.push_back(std::make_unique<btRigidBody>(info));
    btRigidBody& added = *bodies_.back();
    added.setLinearVelocity(to_bullet(body.start.velocity));
    added.setAngularVelocity(to_bullet(body.start.angular_velocity));
    set_surface(body, &added);
    added.setDamping(0.0, 0.0);
    added.setActivationState(DISABLE_DEACTIVATION);
    if (body.shape == Shape::kPoint)
      world_->addRigidBody(&added, 0, 0);
    else
      world_->addRigidBody(&added);
  }

  btRigidBody& body(int i) {
    return i == kWorld ? btTypedConstraint::getFixedBody() : *bodies_[static_cast<std::size_t>(i)];
  }

  Vector3d in_world(int i, const Vector3d& anchor) const {
    if (i == kWorld) return anchor;
    const State& start = problem_.bodies[static_cast<std::size_t>(i)].start;
    return start.position + start.orientation * anchor;
  }

  void add(const Joint& joint) {
    if (joint.kind == JointKind::kSpring) throw Unsupported("springs");
    if (joint.kind == JointKind::kRod && joint.max_force != 0.0)
      throw Unsupported("rods with a force limit");
    if (joint.kind == JointKind::kFreeLength && !joint.is_rope()) return;
    if (joint.kind == JointKind::kBall) {
      joints_.push_back(std::make_unique<btPoint2PointConstraint>(
          body(joint.a), body(joint.b), to_bullet(joint.anchor_a), to_bullet(joint.anchor_b)));
    } else if (has_axes(joint.kind)) {
      add_on_axes(joint);
    } else {
      const double start =
          (in_world(joint.b, joint.anchor_b) - in_world(joint.a, joint.anchor_a)).norm();
      const double length = joint.is_rope()       ? joint.upper
                            : joint.length >= 0.0 ? joint.length
                                                  : start;
      auto rod = std::make_unique<Rod>(body(joint.a), body(joint.b), joint, length);
      if (joint.kind == JointKind::kRod && joint.rate != 0.0)
        motors_.push_back({rod.get(), length, joint.rate});
      if (joint.break_force > 0.0) rod->setBreakingImpulseThreshold(joint.break_force * tick_);
      joints_.push_back(std::move(rod));
    }
    world_->addConstraint(joints_.back().get());
  }

  void add_on_axes(const Joint& joint) {
    if (joint.friction > 0.0 && joint.max_force > 0.0) throw Unsupported("a motor with friction");
    // With Bullet's restitution settings nothing rebounded from a stop, whichever body was first.
    if (joint.restitution > 0.0) throw Unsupported("stops that bounce");
    if (joint.kind == JointKind::kSlider)
      add_slider(joint);
    else if (joint.kind == JointKind::kHinge)
      add_hinge(joint);
    else
      throw Unsupported(name(joint.kind));
  }

  /// Adds a slider along x of its frames.
  void add_slider(const Joint& joint) {
    const Quaterniond x_to_z = rotation_between(Vector3d::UnitX(), Vector3d::UnitZ());
    auto made = std::make_unique<btSliderConstraint>(
        body(joint.a), body(joint.b),
        btTransform(to_bullet(joint.frame_a * x_to_z), to_bullet(joint.anchor_a)),
        btTransform(to_bullet(joint.frame_b * x_to_z), to_bullet(joint.anchor_b)), true);
    if (joint.is_limited()) {
      made->setLowerLinLimit(std::max(joint.lower, -kFar));
      made->setUpperLinLimit(std::min(joint.upper, kFar));
    }
    if (const double force = joint.friction + joint.max_force; force > 0.0) {
      made->setPoweredLinMotor(true);
      made->setTargetLinMotorVelocity(joint.rate);
      made->setMaxLinMotorForce(force);
    }
    joints_.push_back(std::move(made));
  }

  /// Adds a hinge about z of its frames.
  void add_hinge(const Joint& joint) {
    if (joint.friction + joint.max_force > 0.0) throw Unsupported("motors of hinges");
    auto made = std::make_unique<btHingeConstraint>(
        body(joint.a), body(joint.b),
        btTransform(to_bullet(joint.frame_a), to_bullet(joint.anchor_a)),
        btTransform(to_bullet(joint.frame_b), to_bullet(joint.anchor_b)), true);
    if (joint.is_limited())  // Bullet's relaxation factor is a restitution
      made->setLimit(std::max(joint.lower, -kFar), std::min(joint.upper, kFar), 0.9, 0.3, 0.0);
    joints_.push_back(std::move(made));
  }

  const Problem& problem_;
  double tick_;
  double time_ = 0.0;
  Collisions collisions_;
  btDantzigSolver dantzig_;
  std::unique_ptr<btConstraintSolver> solver_;
  std::unique_ptr<btDiscreteDynamicsWorld> world_;
  Shapes shapes_;
  std::vector<std::unique_ptr<btRigidBody>> bodies_;
  std::vector<std::unique_ptr<btTypedConstraint>> joints_;
  std::vector<Motor> motors_;
};

/// Articulated bodies in joint coordinates: one multi-body for each tree that hangs on the world or
/// is free, links numbered as in the tree.
class FeatherstoneSimulation : public Simulation {
 public:
  FeatherstoneSimulation(const Problem& problem, double tick) : problem_(problem), tick_(tick) {
    check_without_axes(problem);
    check_without_laws(problem);
    world_.setGravity(to_bullet(problem.gravity));
    world_.getSolverInfo().m_numIterations = kSweeps;
    place_.resize(problem.bodies.size());
    const std::vector<Link> tree = tree_of(problem);
    for (const Link& link : tree) {
      Place& place = place_[static_cast<std::size_t>(link.body)];
      if (body(link.body).is_static) continue;
      if (link.parent == kWorld) {
        place.tree = counts_.size();
        counts_.push_back(link.is_hung ? 1 : 0);
        place.link = link.is_hung ? 0 : -1;
      } else {
        place.tree = place_[static_cast<std::size_t>(link.parent)].tree;
        place.link = counts_[place.tree]++;
      }
    }
    for (const Link& link : tree)
      if (!body(link.body).is_static) add(link);
    for (const auto& tree_body : trees_) {
      tree_body->finalizeMultiDof();
      world_.addMultiBody(tree_body.get());
    }
    for (const Link& link : tree)
      if (!body(link.body).is_static) set_velocity(link);
    for (std::size_t i = 0; i < place_.size(); ++i) add_shape(i);
  }

  ~FeatherstoneSimulation() override {
    for (const auto& object : objects_) world_.removeCollisionObject(object.get());
    for (const auto& tree : trees_) world_.removeMultiBody(tree.get());
  }

  void advance(long ticks, double) override {
    for (long i = 0; i < ticks; ++i) {
      for (std::size_t k = 0; k < place_.size(); ++k)
        if (!problem_.bodies[k].force.isZero(0.0)) push(place_[k], problem_.bodies[k].force);
      world_.stepSimulation(tick_, 0);
    }
  }

  void read(States* states) const override {
    states->assign(place_.size(), State());
    btAlignedObjectArray<btQuaternion> turns;
    btAlignedObjectArray<btVector3> origins;
    for (const auto& tree : trees_) tree->forwardKinematics(turns, origins);
    // Velocities of base and links of each tree.
    std::vector<std::vector<btVector3>> omega(trees_.size()), velocity(trees_.size());
    for (std::size_t k = 0; k < trees_.size(); ++k) {
      const auto count = static_cast<std::size_t>(trees_[k]->getNumLinks()) + 1;
      omega[k].resize(count);
      velocity[k].resize(count);
      trees_[k]->compTreeLinkVelocities(omega[k].data(), velocity[k].data());
    }
    for (std::size_t i = 0; i < place_.size(); ++i) {
      const Place& place = place_[i];
      if (problem_.bodies[i].is_static) {
        (*states)[i] = problem_.bodies[i].start;
        continue;
      }
      const btMultiBody& tree = *trees_[place.tree];
      const btTransform pose = place.link < 0 ? tree.getBaseWorldTransform()
                                              : tree.getLink(place.link).m_cachedWorldTransform;
      const auto at = static_cast<std::size_t>(place.link + 1);
      (*states)[i] = {from_bullet(pose.getOrigin()), from_bullet(pose.getRotation()),
                      from_bullet(pose.getBasis() * velocity[place.tree][at]),
                      from_bullet(pose.getBasis() * omega[place.tree][at])};
    }
  }

 private:
  struct Place {
    std::size_t tree = 0;
    int link = 0;  // -1: the base
  };

  static constexpr int kSweeps = 50;  // over contacts

  void push(const Place& place, const Vector3d& force) {
    if (place.link < 0)
      trees_[place.tree]->addBaseForce(to_bullet(force));
    else
      trees_[place.tree]->addLinkForce(place.link, to_bullet(force));
  }

  void add_shape(std::size_t i) {
    const Body& shaped = problem_.bodies[i];
    if (shaped.shape == Shape::kPoint) return;
    const Place& place = place_[i];
    int group = btBroadphaseProxy::DefaultFilter, mask = btBroadphaseProxy::AllFilter;
    if (shaped.is_static) {
      objects_.push_back(std::make_unique<btCollisionObject>());
      group = btBroadphaseProxy::StaticFilter;
      mask = btBroadphaseProxy::DefaultFilter;
    } else {
      btMultiBody* tree = trees_[place.tree].get();
      auto collider = std::make_unique<btMultiBodyLinkCollider>(tree, place.link);
      if (place.link < 0)
        tree->setBaseCollider(collider.get());
      else
        tree->getLink(place.link).m_collider = collider.get();
      objects_.push_back(std::move(collider));
    }
    btCollisionObject& object = *objects_.back();
    object.setCollisionShape(shapes_.add(shaped));
    object.setWorldTransform(start_of(shaped));
    set_surface(shaped, &object);
    world_.addCollisionObject(&object, group, mask);
  }

  const Body& body(int i) const { return problem_.bodies[static_cast<std::size_t>(i)]; }

  void add(const Link& link) {
    const Body& added = body(link.body);
    const Place& place = place_[static_cast<std::size_t>(link.body)];
    const btVector3 inertia = to_bullet(inertia_of(problem_, added));
    if (link.parent == kWorld) {
      if (!link.is_hung && added.inertia.isZero(0.0))
        throw Unsupported("a free point mass as the root of joint coordinates");
      trees_.push_back(std::make_unique<btMultiBody>(
          counts_[place.tree], link.is_hung ? 0.0 : added.mass, inertia, link.is_hung, false));
      btMultiBody& tree = *trees_.back();
      tree.useRK4Integration(true);
      tree.setLinearDamping(0.0);
      tree.setAngularDamping(0.0);
      tree.setUseGyroTerm(true);
      tree.setHasSelfCollision(false);
      tree.setMaxCoordinateVelocity(1e300);
      tree.setMaxAppliedImpulse(1e300);
      if (!link.is_hung) {
        tree.setBasePos(to_bullet(added.start.position));
        tree.setWorldToBaseRot(to_bullet(added.start.orientation.conjugate()));
        return;
      }
    }
    const int parent =
        link.parent == kWorld ? -1 : place_[static_cast<std::size_t>(link.parent)].link;
    const Quaterniond turn =
        added.start.orientation.conjugate() *
        (link.parent == kWorld ? Quaterniond::Identity() : body(link.parent).start.orientation);
    btMultiBody& tree = *trees_[place.tree];
    if (problem_.is_planar)
      tree.setupRevolute(place.link, added.mass, inertia, parent, to_bullet(turn),
                         btVector3(0, 1, 0), to_bullet(link.anchor), to_bullet(link.centre), true);
    else
      tree.setupSpherical(place.link, added.mass, inertia, parent, to_bullet(turn),
                          to_bullet(link.anchor), to_bullet(link.centre), true);
    spins_.resize(problem_.bodies.size(), Vector3d::Zero());
    spins_[static_cast<std::size_t>(link.body)] = start_spin(problem_, link);
  }

  void set_velocity(const Link& link) {
    const Body& moved = body(link.body);
    const Place& place = place_[static_cast<std::size_t>(link.body)];
    btMultiBody& tree = *trees_[place.tree];
    if (!link.is_hung) {
      tree.setBaseVel(to_bullet(moved.start.velocity));
      tree.setBaseOmega(to_bullet(moved.start.angular_velocity));
      return;
    }
    Vector3d spin = spins_[static_cast<std::size_t>(link.body)];
    if (link.parent != kWorld) spin -= spins_[static_cast<std::size_t>(link.parent)];
    if (problem_.is_planar) {
      tree.setJointVel(place.link, spin.y());
    } else {
      const Vector3d local = moved.start.orientation.conjugate() * spin;
      tree.setJointVelMultiDof(place.link, local.data());
    }
  }

  const Problem& problem_;
  double tick_;
  Collisions collisions_;
  btMultiBodyConstraintSolver solver_;
  btMultiBodyDynamicsWorld world_{&collisions_.dispatcher, &collisions_.broadphase, &solver_,
                                  &collisions_.configuration};
  std::vector<Place> place_;
  std::vector<int> counts_;
  std::vector<Vector3d> spins_;
  std::vector<std::unique_ptr<btMultiBody>> trees_;
  Shapes shapes_;
  std::vector<std::unique_ptr<btCollisionObject>> objects_;
};

}  // namespace

std::string Contestant::name() { return "bullet"; }
std::string Contestant::version() { return CONSTRAINT_SIM_PEER_VERSION; }

std::vector<Variant> Contestant::variants() {
  return {{"sequential_impulses_10"},
          {"sequential_impulses_50"},
          {"sequential_impulses_200"},
          {"dantzig"},
          {"featherstone_rk4", true}};
}

std::unique_ptr<Simulation> Contestant::make(const Problem& problem, const Variant& variant,
                                             const Setting& setting) {
  if (variant.has_joint_coordinates)
    return std::make_unique<FeatherstoneSimulation>(problem, setting.tick);
  return std::make_unique<BulletSimulation>(problem, variant.name, setting.tick);
}

}  // namespace constraint_sim::report
