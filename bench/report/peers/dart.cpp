// needs: pkg-config dart
//
// DART: articulated bodies in joint coordinates with its semi-implicit Euler method, loops of ball
// joints by its constraint solver. Its ABI depends on AVX flags; this package is built without
// them.

#include <dart/dart.hpp>

#include "../tree.h"

namespace constraint_sim::report {
namespace {

using Eigen::Isometry3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr double kGround = 100.0;     // edge of the box that represents a plane [m], at least
constexpr double kWideGround = 30.0;  // edge of that box over the length of the scene

class DartSimulation : public Simulation {
 public:
  DartSimulation(const Problem& problem, double tick)
      : problem_(problem), world_(dart::simulation::World::create()) {
    check_without_axes(problem);
    check_without_laws(problem);
    world_->setGravity(problem.gravity);
    world_->setTimeStep(tick);
    if (problem.has_shapes())
      world_->getConstraintSolver()->setCollisionDetector(
          dart::collision::DARTCollisionDetector::create());
    for (const Body& body : problem.bodies)  // DART takes the lower of two
      if (body.friction != problem.bodies.front().friction)
        throw Unsupported("friction by the geometric mean");
    nodes_.resize(problem.bodies.size());
    std::vector<Joint> loops;
    for (const Link& link : tree_of(problem, &loops)) add(link);
    for (const Joint& joint : loops) close(joint);
    for (std::size_t i = 0; i < nodes_.size(); ++i)
      if (!problem.bodies[i].force.isZero(0.0)) pushed_.push_back(i);
  }

  void advance(long ticks, double) override {
    for (long i = 0; i < ticks; ++i) {
      for (const std::size_t k : pushed_)
        nodes_[k]->addExtForce(problem_.bodies[k].force, nodes_[k]->getLocalCOM(), false, true);
      world_->step();
    }
  }

  void read(States* states) const override {
    states->clear();
    for (const dart::dynamics::BodyNode* node : nodes_)
      states->push_back({node->getCOM(), Quaterniond(node->getWorldTransform().linear()),
                         node->getCOMLinearVelocity(), node->getAngularVelocity()});
  }

 private:
  using Spin = Vector3d;

  static Isometry3d pose(const Vector3d& position, const Quaterniond& orientation) {
    Isometry3d transform = Isometry3d::Identity();
    transform.linear() = orientation.toRotationMatrix();
    transform.translation() = position;
    return transform;
  }

  template <class JointClass>
  void add_node(const Link& link, dart::dynamics::BodyNode* parent,
                const typename JointClass::Properties& joint) {
    const Body& body = problem_.bodies[static_cast<std::size_t>(link.body)];
    const Vector3d I = inertia_of(problem_, body);
    dart::dynamics::BodyNode::Properties properties;
    properties.mName = "body_" + std::to_string(link.body);
    properties.mInertia =
        dart::dynamics::Inertia(body.is_static ? 1.0 : body.mass, link.centre, I.asDiagonal());
    dart::dynamics::SkeletonPtr skeleton;
    if (parent == nullptr) {
      skeleton = dart::dynamics::Skeleton::create("skeleton_" + std::to_string(link.body));
      if (body.is_static) skeleton->setMobile(false);
      nodes_[static_cast<std::size_t>(link.body)] =
          skeleton->createJointAndBodyNodePair<JointClass>(nullptr, joint, properties).second;
    } else {
      nodes_[static_cast<std::size_t>(link.body)] =
          parent->createChildJointAndBodyNodePair<JointClass>(joint, properties).second;
    }
    add_shape(link, body);
    if (skeleton != nullptr) world_->addSkeleton(skeleton);
  }

  void add(const Link& link) {
    const auto i = static_cast<std::size_t>(link.body);
    const Body& body = problem_.bodies[i];
    spins_.resize(nodes_.size(), Vector3d::Zero());
    spins_[i] = start_spin(problem_, link);
    const auto parent_index = static_cast<std::size_t>(link.parent);
    dart::dynamics::BodyNode* parent = link.parent == kWorld ? nullptr : nodes_[parent_index];
    Vector3d at = link.is_hung ? link.anchor : body.start.position;
    Quaterniond turn = body.start.orientation;
    Vector3d spin = spins_[i];
    if (parent != nullptr) {
      at += parent->getInertia().getLocalCOM();
      turn = problem_.bodies[parent_index].start.orientation.conjugate() * turn;
      spin -= spins_[parent_index];
    }
    const auto common = [&](auto properties) {
      properties.mName = "joint_" + std::to_string(link.body);
      properties.mT_ParentBodyToJoint = pose(at, turn);
      return properties;
    };
    const Vector3d local_spin = body.start.orientation.conjugate() * spin;
    if (body.is_static) {
      add_node<dart::dynamics::WeldJoint>(link, parent,
                                          common(dart::dynamics::WeldJoint::Properties()));
    } else if (link.is_hung && problem_.is_planar) {
      auto properties = common(dart::dynamics::RevoluteJoint::Properties());
      properties.mAxis = Vector3d::UnitY();
      add_node<dart::dynamics::RevoluteJoint>(link, parent, properties);
      nodes_[i]->getParentJoint()->setVelocity(0, spin.y());
    } else if (link.is_hung) {
      add_node<dart::dynamics::BallJoint>(link, parent,
                                          common(dart::dynamics::BallJoint::Properties()));
      nodes_[i]->getParentJoint()->setVelocities(local_spin);
    } else if (body.inertia.isZero(0.0)) {
      add_node<dart::dynamics::TranslationalJoint>(
          link, parent, common(dart::dynamics::TranslationalJoint::Properties()));
      nodes_[i]->getParentJoint()->setVelocities(body.start.velocity);
    } else {
      add_node<dart::dynamics::FreeJoint>(link, parent,
                                          common(dart::dynamics::FreeJoint::Properties()));
      Eigen::Matrix<double, 6, 1> velocities;
      velocities << local_spin, body.start.orientation.conjugate() * body.start.velocity;
      nodes_[i]->getParentJoint()->setVelocities(velocities);
    }
  }

  /// Closes a loop of ball joints. DART has no rods; a light bar on two ball joints in place of
  /// one, with 1e-6 to 1e-2 of the mass that it holds, made four-bars diverge at every tick tried.
  void close(const Joint& joint) {
    if (joint.kind != JointKind::kBall) throw Unsupported("closed loops of rods");
    const auto b = static_cast<std::size_t>(joint.b);
    const State& start = problem_.bodies[b].start;
    const Vector3d at = start.position + start.orientation * joint.anchor_b;
    using dart::constraint::BallJointConstraint;
    world_->getConstraintSolver()->addConstraint(
        joint.a == kWorld ? std::make_shared<BallJointConstraint>(nodes_[b], at)
                          : std::make_shared<BallJointConstraint>(
                                nodes_[b], nodes_[static_cast<std::size_t>(joint.a)], at));
  }

  void add_shape(const Link& link, const Body& body) {
    if (body.shape == Shape::kPoint) return;
    dart::dynamics::ShapePtr shape;
    Vector3d offset = link.centre;
    if (body.shape == Shape::kSphere) {
      shape = std::make_shared<dart::dynamics::SphereShape>(body.size.x());
    } else if (body.shape == Shape::kBox) {
      shape = std::make_shared<dart::dynamics::BoxShape>(body.size);
    } else {
      const double edge = std::max(kGround, kWideGround * problem_.length);
      shape = std::make_shared<dart::dynamics::BoxShape>(Vector3d::Constant(edge));
      offset.z() -= edge / 2.0;
    }
    auto* node =
        nodes_[static_cast<std::size_t>(link.body)]
            ->createShapeNodeWith<dart::dynamics::CollisionAspect, dart::dynamics::DynamicsAspect>(
                shape);
    node->setRelativeTranslation(offset);
    node->getDynamicsAspect()->setFrictionCoeff(body.friction);
    node->getDynamicsAspect()->setRestitutionCoeff(std::sqrt(body.restitution));
  }

  const Problem& problem_;
  dart::simulation::WorldPtr world_;
  std::vector<dart::dynamics::BodyNode*> nodes_;
  std::vector<Vector3d> spins_;
  std::vector<std::size_t> pushed_;
};

}  // namespace

std::string Contestant::name() { return "dart"; }
std::string Contestant::version() { return CONSTRAINT_SIM_PEER_VERSION; }

std::vector<Variant> Contestant::variants() { return {{"joint", true}}; }

std::unique_ptr<Simulation> Contestant::make(const Problem& problem, const Variant&,
                                             const Setting& setting) {
  return std::make_unique<DartSimulation>(problem, setting.tick);
}

}  // namespace constraint_sim::report
