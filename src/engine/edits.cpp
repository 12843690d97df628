// Adding, removing and changing what a World holds. Each function checks everything first and
// changes something only when nothing can fail any more.

#include <algorithm>
#include <cmath>

#include "engine/constraints/distance.h"
#include "engine/constraints/joint.h"
#include "engine/validate.h"
#include "engine/world_impl.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kCoincident = 1e-9;  // of the anchors' coordinates: nearer than this is one point
constexpr double kPi = 3.14159265358979323846;

MassProperties mass_properties(const Body& body) {
  MassProperties mass;
  if (body.type != BodyType::kDynamic) return mass;
  mass.inverse_mass = 1.0 / body.mass;
  mass.inertia = body.inertia;
  if (mass.inertia.isZero(0.0)) mass.inertia = body.mass * unit_inertia(body.shape);
  if (!mass.inertia.isZero(0.0)) mass.inverse_inertia = mass.inertia.cwiseInverse();
  return mass;
}

// a quaternion that is already one to round-off stays as it is, so that saving and loading does
void normalize(Eigen::Quaterniond& q) {
  if (std::abs(q.squaredNorm() - 1.0) > 1e-15) q.normalize();
}

template <class Map>
auto find_in(const Map& map, std::string_view name, const char* kind) {
  const auto found = map.find(std::string(name));
  if (found == map.end()) refuse(kind, "there is none named '" + std::string(name) + "'");
  return found->second;
}

}  // namespace

World::World(const WorldOptions& options) : impl_(std::make_unique<Impl>()) {
  validate(options);
  impl_->options = options;
  Body world;
  world.name = "world";
  world.type = BodyType::kStatic;
  world.no_collision = true;
  impl_->bodies.push_back(world);
  impl_->states.push_back(world.state);
  impl_->masses.emplace_back();
  impl_->body_ids.push_back(kWorldBody);
  impl_->body_index.push_back(0);
  impl_->body_by_name.emplace(world.name, kWorldBody);
}

World::World(const World& other) : impl_(std::make_unique<Impl>(*other.impl_)) {}
World::World(World&&) noexcept = default;
World& World::operator=(const World& other) {
  if (impl_)
    *impl_ = *other.impl_;  // reuses what is allocated
  else
    impl_ = std::make_unique<Impl>(*other.impl_);
  return *this;
}
World& World::operator=(World&&) noexcept = default;
World::~World() = default;

// ---- options and time

const WorldOptions& World::options() const { return impl_->options; }

void World::set_options(const WorldOptions& options) {
  validate(options);
  if (options.time_step != impl_->options.time_step) set_time(time(), step_count());
  impl_->options = options;
  impl_->edited = true;
}

double World::time() const { return impl_->time(); }
std::uint64_t World::step_count() const { return impl_->step_count; }
void World::set_clock(Clock clock) { impl_->clock = clock; }

void World::set_time(double time, std::uint64_t step_count) {
  check_finite("time", time);
  for (JointState& joint : impl_->joint_states) joint.expires_at += time - this->time();
  impl_->base_time = time;
  impl_->base_step = step_count;
  impl_->step_count = step_count;
}

void World::continue_from(const World& other) {
  set_time(other.time(), other.step_count());
  const auto new_bodies = static_cast<std::uint32_t>(other.impl_->body_index.size()) - 1;
  const auto new_joints = static_cast<std::uint32_t>(other.impl_->joint_index.size());
  const auto renumber = [&](BodyId& id) {
    if (id != kWorldBody) id.value += new_bodies;
  };
  for (BodyId& id : impl_->body_ids) renumber(id);
  for (auto& [name, id] : impl_->body_by_name) renumber(id);
  for (Joint& joint : impl_->joints) {
    renumber(joint.body_a);
    renumber(joint.body_b);
    // a sinusoid goes on as it would have from time 0
    Motor& motor = joint.motor;
    if (motor.frequency > 0.0)
      motor.phase =
          std::remainder(motor.phase - 2.0 * kPi * motor.frequency * other.time(), 2.0 * kPi);
  }
  for (JointId& id : impl_->joint_ids) id.value += new_joints;
  for (auto& [name, id] : impl_->joint_by_name) id.value += new_joints;
  impl_->body_index.insert(impl_->body_index.begin() + 1, new_bodies, -1);
  impl_->joint_index.insert(impl_->joint_index.begin(), new_joints, -1);
  impl_->touching.clear();
  impl_->contacts.clear();
  impl_->edited = true;
}

// ---- bodies

std::size_t World::Impl::index(BodyId id) const {
  const bool known = id.value < body_index.size() && body_index[id.value] >= 0;
  if (!known) refuse("body", "there is none with id " + std::to_string(id.value));
  return static_cast<std::size_t>(body_index[id.value]);
}

BodyId World::add_body(const Body& body) {
  validate(body);
  if (has_body(body.name)) refuse("name", "there is already a body named '" + body.name + "'");

  const BodyId id{static_cast<std::uint32_t>(impl_->body_index.size())};
  impl_->body_index.push_back(static_cast<int>(impl_->bodies.size()));
  impl_->bodies.push_back(body);
  normalize(impl_->bodies.back().state.orientation);
  impl_->states.push_back(impl_->bodies.back().state);
  impl_->masses.push_back(mass_properties(body));
  impl_->body_ids.push_back(id);
  impl_->body_by_name.emplace(body.name, id);
  impl_->edited = true;
  return id;
}

std::vector<std::string> World::remove_body(BodyId id) {
  const std::size_t i = impl_->index(id);
  if (id == kWorldBody) refuse("name", "'world' cannot be removed");

  std::vector<std::string> removed;
  for (std::size_t j = impl_->joints.size(); j-- > 0;) {
    const Joint& joint = impl_->joints[j];
    if (joint.body_a != id && joint.body_b != id) continue;
    removed.insert(removed.begin(), joint.name);
    impl_->erase_joint(j);
  }

  const auto at = static_cast<std::ptrdiff_t>(i);
  impl_->body_by_name.erase(impl_->bodies[i].name);
  impl_->bodies.erase(impl_->bodies.begin() + at);
  impl_->states.erase(impl_->states.begin() + at);
  impl_->masses.erase(impl_->masses.begin() + at);
  impl_->body_ids.erase(impl_->body_ids.begin() + at);
  impl_->body_index[id.value] = -1;
  for (std::size_t k = i; k < impl_->body_ids.size(); ++k)
    --impl_->body_index[impl_->body_ids[k].value];
  impl_->contacts.clear();
  impl_->edited = true;
  return removed;
}

bool World::has_body(std::string_view name) const {
  return impl_->body_by_name.count(std::string(name)) > 0;
}

BodyId World::find_body(std::string_view name) const {
  return find_in(impl_->body_by_name, name, "body");
}

std::vector<BodyId> World::body_ids() const {
  return {impl_->body_ids.begin() + 1, impl_->body_ids.end()};
}

const Body& World::body(BodyId id) const { return impl_->bodies[impl_->index(id)]; }
const BodyState& World::state(BodyId id) const { return impl_->states[impl_->index(id)]; }

void World::set_state(BodyId id, const BodyState& state) {
  const std::size_t i = impl_->index(id);
  if (id == kWorldBody) refuse("name", "'world' cannot be moved");
  Body body = impl_->bodies[i];
  body.state = state;
  validate(body);

  impl_->states[i] = state;
  normalize(impl_->states[i].orientation);
  for (std::size_t j = 0; j < impl_->joints.size(); ++j) {
    const Joint& joint = impl_->joints[j];
    if (joint.body_a == id || joint.body_b == id)
      begin_joint(joint, this->state(joint.body_a), this->state(joint.body_b),
                  impl_->joint_states[j]);
  }
  impl_->edited = true;
}

// ---- joints

std::size_t World::Impl::index(JointId id) const {
  const bool known = id.value < joint_index.size() && joint_index[id.value] >= 0;
  if (!known) refuse("constraint", "there is none with id " + std::to_string(id.value));
  return static_cast<std::size_t>(joint_index[id.value]);
}

JointId World::add_joint(const Joint& joint) {
  validate(joint);
  if (has_joint(joint.name))
    refuse("name", "there is already a constraint named '" + joint.name + "'");
  impl_->check_ends(joint);
  Joint filled = joint;
  impl_->fill_in(filled);

  const JointId id{static_cast<std::uint32_t>(impl_->joint_index.size())};
  impl_->joint_index.push_back(static_cast<int>(impl_->joints.size()));
  impl_->joints.push_back(filled);
  JointState& state = impl_->joint_states.emplace_back();
  begin_joint(filled, this->state(filled.body_a), this->state(filled.body_b), state);
  if (filled.motor.timeout > 0.0) state.expires_at = time() + filled.motor.timeout;
  impl_->joint_ids.push_back(id);
  impl_->joint_by_name.emplace(joint.name, id);
  impl_->edited = true;
  return id;
}

void World::Impl::check_ends(const Joint& joint) const {
  const std::size_t a = index(joint.body_a);
  const std::size_t b = index(joint.body_b);
  const std::string names = "'" + bodies[a].name + "' and '" + bodies[b].name + "'";
  if (a == b) refuse("body_b", "must be another body than body_a, got " + names);
  if (!is_movable(a) && !is_movable(b))
    refuse("body_b", "one of the two bodies must be dynamic, got " + names);
  const auto check_anchor = [&](const char* field, std::size_t i, const Vector3d& anchor) {
    const bool cannot_turn = is_movable(i) && masses[i].inertia.isZero(0.0);
    if (cannot_turn && !anchor.isZero(0.0))
      refuse(field, "'" + bodies[i].name +
                        "' is a point mass without inertia, its anchor must be (0, 0, 0), got " +
                        shown(anchor));
  };
  check_anchor("anchor_a", a, joint.anchor_a);
  check_anchor("anchor_b", b, joint.anchor_b);
}

// the length as it is, the ball joint that a length of zero asks for, and a spring's constants
void World::Impl::fill_in(Joint& joint) const {
  auto* distance = std::get_if<DistanceJoint>(&joint.type);
  if (distance == nullptr) return;
  const std::size_t a = index(joint.body_a);
  const std::size_t b = index(joint.body_b);
  const AnchorPair anchors(joint, states[a], states[b]);

  if (!is_between_limits(*distance) && !distance->length) {
    const double size = std::max({anchors.p_A.norm(), anchors.r_A.norm(), anchors.r_B.norm()});
    const double present = anchors.d.norm();
    distance->length = present <= kCoincident * size ? 0.0 : present;
  }
  if (distance->length == 0.0 && !distance->is_soft()) {
    joint.type = BallJoint{};
  } else if (distance->frequency > 0.0) {
    const Jacobian J = anchors.along(direction(anchors));
    const double constraint_mass = inverse_mass_along(J, a, b);
    const double omega = 2.0 * kPi * distance->frequency;
    distance->stiffness = omega * omega / constraint_mass;
    distance->damping = 2.0 * distance->damping_ratio * omega / constraint_mass;
    distance->frequency = distance->damping_ratio = 0.0;
  }
  validate(joint);  // a ball joint has no motor, and what followed from the rest may be too large
}

// J M⁻¹ Jᵀ of one row between two bodies
double World::Impl::inverse_mass_along(const Jacobian& J, std::size_t a, std::size_t b) const {
  const auto turning = [&](std::size_t i, const Vector3d& j) {
    const Vector3d j_B = states[i].orientation.conjugate() * j;
    return j_B.dot(masses[i].inverse_inertia.cwiseProduct(j_B));
  };
  return masses[a].inverse_mass * J.j1.squaredNorm() + turning(a, J.j2) +
         masses[b].inverse_mass * J.j3.squaredNorm() + turning(b, J.j4);
}

void World::Impl::erase_joint(std::size_t j) {
  const auto at = static_cast<std::ptrdiff_t>(j);
  joint_index[joint_ids[j].value] = -1;
  joint_by_name.erase(joints[j].name);
  joints.erase(joints.begin() + at);
  joint_states.erase(joint_states.begin() + at);
  joint_ids.erase(joint_ids.begin() + at);
  for (std::size_t k = j; k < joint_ids.size(); ++k) --joint_index[joint_ids[k].value];
  edited = true;
}

void World::remove_joint(JointId id) { impl_->erase_joint(impl_->index(id)); }

bool World::has_joint(std::string_view name) const {
  return impl_->joint_by_name.count(std::string(name)) > 0;
}

JointId World::find_joint(std::string_view name) const {
  return find_in(impl_->joint_by_name, name, "constraint");
}

const std::vector<JointId>& World::joint_ids() const { return impl_->joint_ids; }
const Joint& World::joint(JointId id) const { return impl_->joints[impl_->index(id)]; }
const JointState& World::joint_state(JointId id) const {
  return impl_->joint_states[impl_->index(id)];
}

World::Anchors World::anchors(JointId id) const {
  const Joint& joint = this->joint(id);
  const AnchorPair pair(joint, state(joint.body_a), state(joint.body_b));
  return {pair.p_A, pair.p_A + pair.d};
}

void World::set_motor(JointId id, const Motor& motor) {
  const std::size_t j = impl_->index(id);
  Joint joint = impl_->joints[j];
  joint.motor = motor;
  validate(joint);

  impl_->joints[j] = joint;
  impl_->joint_states[j].expires_at =
      motor.timeout > 0.0 ? time() + motor.timeout : std::numeric_limits<double>::infinity();
  impl_->edited = true;
}

void World::set_broken(JointId id, bool broken) {
  const Joint& joint = this->joint(id);
  JointState& state = impl_->joint_states[impl_->index(id)];
  state.broken = broken;
  state.impulse.setZero();
  begin_joint(joint, this->state(joint.body_a), this->state(joint.body_b), state);
  impl_->edited = true;
}

// ---- asking

const StepReport& World::report() const { return impl_->report; }
const std::vector<Contact>& World::contacts() const { return impl_->contacts; }
double World::energy() const { return impl_->kinetic_energy() + impl_->potential_energy(); }

const char* name(Method method) { return method == Method::kAuto ? "auto" : "sequential_impulses"; }

const char* name(Stage stage) {
  constexpr std::array<const char*, kStageCount> kNames = {
      "broadphase", "narrowphase", "rows", "velocities", "solve", "positions"};
  return kNames[static_cast<std::size_t>(stage)];
}

}  // namespace constraint_sim::engine
