// needs: library mujoco
//
// MuJoCo: joint coordinates, and Cartesian coordinates with tendons for rods, each with its
// semi-implicit Euler method and RK4. Coupled coordinates are equality constraints, lengths on a
// pulley are a tendon. Ropes are tendons with a range; a motor with a force limit is a velocity
// servo that reaches its rate in one step.

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <sstream>

#include "../tree.h"

namespace constraint_sim::report {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

/// Turns an error of MuJoCo, which would call abort(), into an exception.
void throw_error(const char* text) { throw Refused(text); }
void be_silent(const char*) {}

/// Formats numbers without loss.
std::string text(const Vector3d& v) {
  std::ostringstream out;
  out.precision(17);
  out << v.x() << ' ' << v.y() << ' ' << v.z();
  return out.str();
}
std::string text(const Quaterniond& q) {
  std::ostringstream out;
  out.precision(17);
  out << q.w() << ' ' << q.x() << ' ' << q.y() << ' ' << q.z();
  return out.str();
}
std::string text(double x) {
  std::ostringstream out;
  out.precision(17);
  out << x;
  return out.str();
}
std::string name_of(const char* kind, std::size_t i) { return kind + std::to_string(i); }

/// Number of nested bodies in one file of the model: MuJoCo's parser allows a hundred nested
/// elements per file.
constexpr int kDeepest = 50;
constexpr double kLeastInertia = 1e-14;  // MuJoCo rejects inertias below a tenth of it [kg m²]
constexpr double kFar = 1e3;             // beyond the coordinates of problems [m or rad]
constexpr int kMostPairs =
    40;  // largest number of bodies for which every pair is listed with its own friction

class Writer {
 public:
  Writer(const Problem& problem, const Variant& variant, double tick)
      : problem_(problem), tick_(tick), is_jointed_(variant.has_joint_coordinates) {
    const bool is_rk4 = variant.name.find("rk4") != std::string::npos;
    const auto bodies = problem.bodies.size();
    const bool has_shapes = problem.has_shapes();
    xml_ << "<mujoco><compiler angle='radian' inertiafromgeom='false' boundmass='0' "
            "boundinertia='0'/>"
         << "<option timestep='" << text(tick) << "' gravity='" << text(problem.gravity)
         << "' integrator='" << (is_rk4 ? "RK4" : "Euler")
         << "' solver='Newton' iterations='100' tolerance='1e-14' cone='elliptic'>"
         << "<flag warmstart='enable'/></option>"
         << "<size nstack='" << (bodies > 300 ? 60000000 : 20000000) << "' njmax='" << most_rows()
         << "' nconmax='" << (has_shapes ? 6 * bodies + 100 : 0) << "'/><worldbody>";
    if (!is_jointed_) check_cartesian();
    if (is_jointed_)
      write_tree();
    else
      write_bodies();
    xml_ << "</worldbody>";
    write_equations();
    if (has_shapes) write_pairs();
    xml_ << "</mujoco>";
    files_.push_back(xml_.str());
  }

  /// Returns the files of the model; the last file is the model and includes the others.
  const std::vector<std::string>& files() const { return files_; }
  static std::string file_name(std::size_t i) { return "part_" + std::to_string(i) + ".xml"; }

 private:
  void write_inertia(const Body& body, const Vector3d& centre) {
    Vector3d inertia = inertia_of(problem_, body);
    if (!is_jointed_ && body.inertia.isZero(0.0)) inertia = inertia.cwiseMax(kLeastInertia);
    xml_ << "<inertial pos='" << text(centre) << "' mass='" << text(body.mass) << "' diaginertia='"
         << text(inertia) << "'/>";
  }

  /// Accepts rods, springs and their anchors, and of couplings only pulleys.
  void check_cartesian() const {
    Problem without = problem_;
    if (!problem_.joints.empty() && !has_axes(problem_.joints.front().kind))
      without.couplings.clear();
    check_without_axes(without);
  }

  /// Returns the number of rows; MuJoCo allocates memory for this number times all velocities.
  std::size_t most_rows() const {
    // a coupling adds one row
    const std::size_t joints = is_jointed_ ? count_laws() : 3 * problem_.joints.size();
    return 10 + joints + (problem_.has_shapes() ? 6 * problem_.bodies.size() + 300 : 0);
  }

  std::size_t count_laws() const {
    std::size_t count = 0;
    for (const Joint& joint : problem_.joints) count += joint.has_law() ? 3 : 0;
    return count;
  }

  void write_slides(bool is_planar) {
    for (const char* axis : {"1 0 0", "0 1 0", "0 0 1"})
      if (!is_planar || std::strcmp(axis, "0 1 0") != 0)
        xml_ << "<joint type='slide' axis='" << axis << "'/>";
  }

  void write_shape(const Body& body, std::size_t i) {
    if (body.shape == Shape::kPoint) return;
    if (body.restitution != 0.0) throw Unsupported("restitution");
    xml_ << "<geom name='" << name_of("geom", i) << "' ";
    if (body.shape == Shape::kSphere)
      xml_ << "type='sphere' size='" << text(body.size.x()) << "'";
    else if (body.shape == Shape::kBox)
      xml_ << "type='box' size='" << text(body.size / 2.0) << "'";
    else
      xml_ << "type='plane' size='100 100 1'";
    if (is_small())
      xml_ << " contype='0' conaffinity='0'";
    else if (body.friction != problem_.bodies.front().friction)  // MuJoCo takes the higher of two
      throw Unsupported("friction by the geometric mean of many bodies");
    else
      xml_ << " condim='" << (body.friction > 0.0 ? 3 : 1) << "' friction='" << text(body.friction)
           << " 0 0' solref='" << text(2.0 * tick_) << " 1'";
    xml_ << "/>";
  }

  bool is_small() const { return problem_.bodies.size() <= kMostPairs; }

  void write_pairs() {
    if (!is_small()) return;
    xml_ << "<contact>";
    for (std::size_t i = 0; i < problem_.bodies.size(); ++i)
      for (std::size_t j = 0; j < i; ++j) {
        const Body& a = problem_.bodies[i];
        const Body& b = problem_.bodies[j];
        if (a.shape == Shape::kPoint || b.shape == Shape::kPoint || (a.is_static && b.is_static))
          continue;
        const double mu = std::sqrt(a.friction * b.friction);
        xml_ << "<pair geom1='" << name_of("geom", j) << "' geom2='" << name_of("geom", i)
             << "' condim='" << (mu > 0.0 ? 3 : 1) << "' friction='" << text(mu) << ' ' << text(mu)
             << " 0 0 0' solref='" << text(2.0 * tick_) << " 1'/>";
      }
    xml_ << "</contact>";
  }

  void write_bodies() {
    for (std::size_t i = 0; i < problem_.bodies.size(); ++i) {
      const Body& body = problem_.bodies[i];
      xml_ << "<body name='" << name_of("body", i) << "' pos='" << text(body.start.position)
           << "' quat='" << text(body.start.orientation) << "'>";
      if (!body.is_static) {
        if (body.inertia.isZero(0.0))
          write_slides(false);
        else
          xml_ << "<freejoint/>";
        write_inertia(body, Vector3d::Zero());
      }
      write_shape(body, i);
      write_sites(static_cast<int>(i));
      xml_ << "</body>";
    }
    write_sites(kWorld);
  }

  /// Writes sites of the joints of a body, whose centre is at `centre` in its frame, or of the
  /// world.
  void write_sites(int body, const Vector3d& centre = Vector3d::Zero()) {
    for (std::size_t k = 0; k < problem_.joints.size(); ++k) {
      const Joint& joint = problem_.joints[k];
      if (joint.a == body) write_site(name_of("a", k), joint.anchor_a + centre);
      if (joint.b == body) write_site(name_of("b", k), joint.anchor_b + centre);
    }
  }

  void write_site(const std::string& name, const Vector3d& position) {
    xml_ << "<site name='" << name << "' pos='" << text(position) << "'/>";
  }

  /// Returns the stiffest settings that MuJoCo recommends, for rows of this kind: `limit`,
  /// `friction` or none.
  std::string stiff(const std::string& kind = "") const {
    return " solref" + kind + "='" + text(2.0 * tick_) + " 1' solimp" + kind +
           "='0.9999 0.9999 0.001 0.5 2'";
  }
  std::string solver() const { return stiff() + "/>"; }

  void write_equations() {
    std::ostringstream equality;
    xml_ << "<tendon>";
    for (std::size_t k = 0; k < problem_.joints.size(); ++k) write_length(k);
    if (!is_jointed_) write_joints(&equality);
    for (const Coupling& coupling : problem_.couplings) write_coupling(coupling, &equality);
    xml_ << "</tendon><equality>" << equality.str() << "</equality><actuator>";
    for (std::size_t k = 0; k < problem_.joints.size(); ++k) write_motor(k);
    xml_ << "</actuator>";
  }

  /// Writes a spring or a rope.
  void write_length(std::size_t k) {
    const Joint& joint = problem_.joints[k];
    const bool is_spring = joint.kind == JointKind::kSpring;
    if (!is_spring && !joint.is_rope()) return;
    if (joint.restitution != 0.0) throw Unsupported("restitution");
    xml_ << "<spatial name='" << name_of("rod", k) << "'";
    if (is_spring)
      xml_ << " stiffness='" << text(joint.stiffness) << "' springlength='"
           << text(length_of(joint)) << "'";
    else if (joint.max_force == 0.0)
      xml_ << " limited='true' range='0 " << text(joint.upper) << "'" << stiff("limit");
    write_ends(k);
  }

  void write_ends(std::size_t k) {
    xml_ << "><site site='" << name_of("a", k) << "'/><site site='" << name_of("b", k)
         << "'/></spatial>";
  }

  double start_length(const Joint& joint) const {
    return (in_world(joint.b, joint.anchor_b) - in_world(joint.a, joint.anchor_a)).norm();
  }
  double length_of(const Joint& joint) const {
    return joint.length >= 0.0 ? joint.length : start_length(joint);
  }

  /// Writes the motor of a body that hangs on the world.
  void write_motor(std::size_t k) {
    const Joint& joint = problem_.joints[k];
    if (joint.max_force == 0.0) return;
    const Body& body = problem_.bodies[static_cast<std::size_t>(joint.b)];
    if (joint.a != kWorld || joint.kind == JointKind::kHinge) throw Unsupported("motors of these");
    const bool is_rope = joint.is_rope();
    xml_ << "<velocity "
         << (is_rope ? "tendon='" + name_of("rod", k) : "joint='" + coordinate(k, 0)) << "' kv='"
         << text(body.mass / tick_) << "' forcelimited='true' forcerange='"
         << text(-joint.max_force) << ' ' << text(is_rope ? 0.0 : joint.max_force) << "'/>";
  }

  /// Writes a coupling of coordinates that are zero at the start: q₁ = −ratio q₂.
  void write_coupling(const Coupling& coupling, std::ostringstream* equality) {
    const auto first = static_cast<std::size_t>(coupling.first);
    const auto second = static_cast<std::size_t>(coupling.second);
    if (problem_.joints[first].kind == JointKind::kFreeLength) {
      xml_ << "<spatial name='" << name_of("rope", first) << "'><site site='" << name_of("a", first)
           << "'/><site site='" << name_of("b", first) << "'/><pulley divisor='"
           << text(1.0 / coupling.ratio) << "'/><site site='" << name_of("a", second)
           << "'/><site site='" << name_of("b", second) << "'/></spatial>";
      *equality << "<tendon tendon1='" << name_of("rope", first) << "'" << solver();
      return;
    }
    *equality << "<joint joint1='" << coordinate(first, 0) << "' joint2='"
              << coordinate(second, coupling.is_screw() ? 1 : 0) << "' polycoef='0 "
              << text(-coupling.ratio) << " 0 0 0'" << solver();
  }

  static std::string coordinate(std::size_t joint, int number) {
    return name_of("q", joint) + "_" + std::to_string(number);
  }

  void write_joints(std::ostringstream* equality) {
    for (std::size_t k = 0; k < problem_.joints.size(); ++k) {
      const Joint& joint = problem_.joints[k];
      if (joint.kind == JointKind::kRod && joint.rate != 0.0) throw Unsupported("motors of rods");
      if (joint.kind == JointKind::kBall) {
        *equality << "<connect body1='" << name_of("body", static_cast<std::size_t>(joint.b))
                  << "' anchor='" << text(joint.anchor_b) << "'";
        if (joint.a != kWorld)
          *equality << " body2='" << name_of("body", static_cast<std::size_t>(joint.a)) << "'";
        *equality << solver();
        continue;
      }
      if (joint.kind != JointKind::kRod) continue;
      xml_ << "<spatial name='" << name_of("rod", k) << "'";
      *equality << "<tendon name='" << name_of("rod", k) << "' tendon1='" << name_of("rod", k)
                << "' polycoef='" << text(length_of(joint) - start_length(joint)) << " 0 0 0 0'"
                << solver();
      write_ends(k);
    }
  }

  Vector3d in_world(int i, const Vector3d& anchor) const {
    if (i == kWorld) return anchor;
    const State& start = problem_.bodies[static_cast<std::size_t>(i)].start;
    return start.position + start.orientation * anchor;
  }

  void write_tree() {
    const std::vector<Link> tree = tree_of(problem_, nullptr, true);
    std::vector<std::vector<const Link*>> children(problem_.bodies.size());
    for (const Link& link : tree)
      if (link.parent != kWorld) children[static_cast<std::size_t>(link.parent)].push_back(&link);
    for (const Link& link : tree)
      if (link.parent == kWorld)
        write_link(link, Vector3d::Zero(), Quaterniond::Identity(), children);
    if (has_lengths()) write_sites(kWorld);
  }

  /// Returns whether there are lengths: pulleys, ropes or springs.
  bool has_lengths() const {
    return std::any_of(problem_.joints.begin(), problem_.joints.end(), [](const Joint& joint) {
      return joint.kind == JointKind::kFreeLength || joint.kind == JointKind::kSpring;
    });
  }

  void write_link(const Link& link, const Vector3d& parent_centre, const Quaterniond& parent_turn,
                  const std::vector<std::vector<const Link*>>& children) {
    const auto i = static_cast<std::size_t>(link.body);
    const Body& body = problem_.bodies[i];
    const Vector3d position =
        link.is_hung ? Vector3d(parent_centre + link.anchor) : body.start.position;
    xml_ << "<body name='" << name_of("body", i) << "' pos='" << text(position) << "' quat='"
         << text(parent_turn.conjugate() * body.start.orientation) << "'>";
    if (!body.is_static) {
      if (link.joint != nullptr)
        write_axes(*link.joint);
      else if (link.is_hung && problem_.is_planar)
        xml_ << "<joint type='hinge' axis='0 1 0'/>";
      else if (link.is_hung)
        xml_ << "<joint type='ball'/>";
      else if (body.inertia.isZero(0.0))
        write_slides(problem_.is_planar);
      else
        xml_ << "<freejoint/>";
      write_inertia(body, link.centre);
    }
    write_shape(body, i);
    if (has_lengths()) write_sites(link.body, link.centre);
    const bool is_deep = ++depth_ % kDeepest == 0 && !children[i].empty();
    std::ostringstream outer;
    if (is_deep) {
      std::swap(outer, xml_);
      xml_ << "<mujocoinclude>";
    }
    for (const Link* child : children[i])
      write_link(*child, link.centre, body.start.orientation, children);
    if (is_deep) {
      xml_ << "</mujocoinclude>";
      files_.push_back(xml_.str());
      std::swap(outer, xml_);
      xml_ << "<include file='" << file_name(files_.size() - 1) << "'/>";
    }
    --depth_;
    xml_ << "</body>";
  }

  void write_law(const Joint& joint) {
    if (joint.restitution != 0.0) throw Unsupported("restitution");
    const auto finite = [](double limit) { return std::clamp(limit, -kFar, kFar); };
    if (joint.is_limited())
      xml_ << " limited='true' range='" << text(finite(joint.lower)) << ' '
           << text(finite(joint.upper)) << "'" << stiff("limit");
    if (joint.friction > 0.0)
      xml_ << " frictionloss='" << text(joint.friction) << "'" << stiff("friction");
  }

  /// Writes the free coordinates of a joint with axes: slides and hinges, the one nearest to A
  /// first.
  void write_axes(const Joint& joint) {
    const auto in_world_of = [&](int i) {
      return i == kWorld ? Quaterniond::Identity()
                         : problem_.bodies[static_cast<std::size_t>(i)].start.orientation;
    };
    const Quaterniond in_child =
        in_world_of(joint.b).conjugate() * in_world_of(joint.a) * joint.frame_a;
    const Vector3d x = in_child * Vector3d::UnitX(), y = in_child * Vector3d::UnitY(),
                   z = in_child * Vector3d::UnitZ();
    const auto k = static_cast<std::size_t>(&joint - problem_.joints.data());
    int count = 0;
    const auto add = [&](const char* type, const Vector3d& axis) {
      xml_ << "<joint name='" << coordinate(k, count++) << "' type='" << type << "' axis='"
           << text(axis) << "'";
      write_law(joint);
      xml_ << "/>";
    };
    const JointKind kind = joint.kind;
    if (kind == JointKind::kPlanar || kind == JointKind::kPointOnPlane) {
      add("slide", x);
      add("slide", y);
    }
    if (kind == JointKind::kSlider || kind == JointKind::kCylindrical ||
        kind == JointKind::kPointOnLine)
      add("slide", z);
    if (kind == JointKind::kPointOnLine || kind == JointKind::kPointOnPlane)
      xml_ << "<joint type='ball'/>";
    if (kind == JointKind::kHinge || kind == JointKind::kCylindrical ||
        kind == JointKind::kPlanar || kind == JointKind::kUniversal)
      add("hinge", z);
    if (kind == JointKind::kUniversal) add("hinge", joint.frame_b * Vector3d::UnitZ());
  }

  const Problem& problem_;
  double tick_;
  bool is_jointed_;
  int depth_ = 0;
  std::vector<std::string> files_;
  std::ostringstream xml_;
};

class MujocoSimulation : public Simulation {
 public:
  MujocoSimulation(const Problem& problem, const Variant& variant, double tick)
      : problem_(problem) {
    mju_user_error = throw_error;
    mju_user_warning = be_silent;
    const Writer writer(problem, variant, tick);
    const auto folder = std::make_unique<mjVFS>();
    mj_defaultVFS(folder.get());
    for (std::size_t i = 0; i < writer.files().size(); ++i) {
      const std::string& file = writer.files()[i];
      if (mj_makeEmptyFileVFS(folder.get(), Writer::file_name(i).c_str(),
                              static_cast<int>(file.size())) != 0)
        throw Unsupported("more files than MuJoCo keeps in memory");
      std::memcpy(folder->filedata[i], file.data(), file.size());
    }
    char error[500] = "";
    model_ = mj_loadXML(Writer::file_name(writer.files().size() - 1).c_str(), folder.get(), error,
                        sizeof error);
    mj_deleteVFS(folder.get());
    if (model_ == nullptr) throw Refused(error);
    data_ = mj_makeData(model_);
    copy_ = mj_makeData(model_);
    for (std::size_t i = 0; i < problem.bodies.size(); ++i)
      ids_.push_back(mj_name2id(model_, mjOBJ_BODY, name_of("body", i).c_str()));
    if (variant.has_joint_coordinates)
      set_joint_velocities();
    else
      for (std::size_t i = 0; i < ids_.size(); ++i)
        set_velocity(i, problem.bodies[i].start.velocity, problem.bodies[i].start.angular_velocity);
    for (std::size_t i = 0; i < ids_.size(); ++i)
      for (int k = 0; k < 3; ++k) data_->xfrc_applied[6 * ids_[i] + k] = problem.bodies[i].force[k];
    int motors = 0;
    for (std::size_t k = 0; k < problem.joints.size(); ++k) {
      const Joint& joint = problem.joints[k];
      if (joint.max_force > 0.0) data_->ctrl[motors++] = joint.rate;
      if (joint.break_force > 0.0)
        breaking_.emplace_back(mj_name2id(model_, mjOBJ_EQUALITY, name_of("rod", k).c_str()),
                               joint.break_force);
    }
    mj_forward(model_, data_);
  }

  ~MujocoSimulation() override {
    mj_deleteData(copy_);
    mj_deleteData(data_);
    mj_deleteModel(model_);
  }

  void advance(long ticks, double) override {
    for (long i = 0; i < ticks; ++i) {
      mj_step(model_, data_);
      if (!breaking_.empty()) break_rods();
    }
    // MuJoCo restarts from the initial state when a number is not finite.
    for (int kind = 0; kind < mjNWARNING && said_.warning.empty(); ++kind)
      if (data_->warning[kind].number > 0)
        said_.warning =
            mju_warningText(kind, static_cast<std::size_t>(data_->warning[kind].lastinfo));
    if (data_->warning[mjWARN_BADQACC].number + data_->warning[mjWARN_BADQPOS].number +
            data_->warning[mjWARN_BADQVEL].number >
        0)
      is_lost_ = true;
  }

  Said said() const override { return said_; }

  void read(States* states) const override {
    mj_copyData(copy_, model_, data_);
    mj_kinematics(model_, copy_);
    mj_comPos(model_, copy_);
    mj_comVel(model_, copy_);
    states->clear();
    for (std::size_t i = 0; i < ids_.size(); ++i) {
      if (problem_.bodies[i].is_static) {  // MuJoCo puts the centre of mass elsewhere
        states->push_back(problem_.bodies[i].start);
        continue;
      }
      const int id = ids_[i];
      const double* x = copy_->xipos + std::ptrdiff_t{3} * id;
      const double* q = copy_->xquat + std::ptrdiff_t{4} * id;
      double velocity[6];
      mj_objectVelocity(model_, copy_, mjOBJ_BODY, id, velocity, 0);
      State state;
      state.position = {x[0], x[1], x[2]};
      if (is_lost_) state.position.setConstant(std::nan(""));
      state.orientation = Quaterniond(q[0], q[1], q[2], q[3]);
      state.angular_velocity = {velocity[0], velocity[1], velocity[2]};
      state.velocity = {velocity[3], velocity[4], velocity[5]};
      states->push_back(state);
    }
  }

 private:
  void break_rods() {
    for (int row = 0; row < data_->nefc; ++row)
      for (const auto& [id, force] : breaking_)
        if (data_->efc_type[row] == mjCNSTR_EQUALITY && data_->efc_id[row] == id &&
            std::abs(data_->efc_force[row]) > force)
          model_->eq_active[id] = 0;
  }

  /// Sets the velocity of a body that hangs on no joint: slides, or a free joint with its spin in
  /// body axes.
  void set_velocity(std::size_t i, const Vector3d& velocity, const Vector3d& spin) {
    const int id = ids_[i];
    const int count = model_->body_dofnum[id];
    double* v = data_->qvel + model_->body_dofadr[id];
    if (count == 2) {
      v[0] = velocity.x();
      v[1] = velocity.z();
    } else if (count > 0) {
      for (int k = 0; k < 3; ++k) v[k] = velocity[k];
      const Vector3d local = problem_.bodies[i].start.orientation.conjugate() * spin;
      if (count == 6)
        for (int k = 0; k < 3; ++k) v[3 + k] = local[k];
    }
  }

  void set_joint_velocities() {
    std::vector<Vector3d> spins(ids_.size(), Vector3d::Zero());
    for (const Link& link : tree_of(problem_, nullptr, true)) {
      const auto i = static_cast<std::size_t>(link.body);
      const Body& body = problem_.bodies[i];
      spins[i] = start_spin(problem_, link);
      if (body.is_static) continue;
      if (link.joint != nullptr) {
        if (link.rate != 0.0) data_->qvel[model_->body_dofadr[ids_[i]]] = link.rate;
        continue;
      }
      if (!link.is_hung) {
        set_velocity(i, body.start.velocity, body.start.angular_velocity);
        continue;
      }
      Vector3d spin = spins[i];
      if (link.parent != kWorld) spin -= spins[static_cast<std::size_t>(link.parent)];
      double* v = data_->qvel + model_->body_dofadr[ids_[i]];
      if (problem_.is_planar) {
        v[0] = spin.y();
      } else {
        const Vector3d local = body.start.orientation.conjugate() * spin;
        for (int k = 0; k < 3; ++k) v[k] = local[k];
      }
    }
  }

  const Problem& problem_;
  mjModel* model_ = nullptr;
  mjData* data_ = nullptr;
  mjData* copy_ = nullptr;
  std::vector<int> ids_;
  std::vector<std::pair<int, double>> breaking_;  // equality, and its breaking force [N]
  bool is_lost_ = false;
  Said said_;
};

}  // namespace

std::string Contestant::name() { return "mujoco"; }
std::string Contestant::version() { return mj_versionString(); }

std::vector<Variant> Contestant::variants() {
  return {{"joint_euler", true}, {"joint_rk4", true}, {"tendon_euler"}, {"tendon_rk4"}};
}

std::unique_ptr<Simulation> Contestant::make(const Problem& problem, const Variant& variant,
                                             const Setting& setting) {
  return std::make_unique<MujocoSimulation>(problem, variant, setting.tick);
}

}  // namespace constraint_sim::report
