#include "urdf/sdf_model.h"

#include "urdf/parse.h"

#ifdef CONSTRAINT_SIM_READS_SDF

#include <cmath>
#include <exception>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "engine/math/numbers.h"
#include "sim/words.h"
#include "urdf/sdf_links.h"

namespace constraint_sim {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

constexpr double kUnlimited = 1e16;  // limits of SDF from here on are none

/// Collects the messages that libsdformat else prints to the standard error; version 9 drops them.
class SdfMessages {
 public:
#if SDF_MAJOR_VERSION >= 11
  SdfMessages() { sdf::Console::Instance()->GetMsgStream().SetStream(&text_); }
#else
  SdfMessages() { sdf::Console::Instance()->SetQuiet(true); }
#endif
  ~SdfMessages() { sdf::Console::Instance()->SetQuiet(false); }
  SdfMessages(const SdfMessages&) = delete;
  SdfMessages& operator=(const SdfMessages&) = delete;

  /// Returns the first error, which has the reason of the others, without its place in the source.
  std::string first_error() const {
    std::istringstream lines(text_.str());
    for (std::string line; std::getline(lines, line);) {
      const std::size_t place = line.find("Error ["), color = line.find("[0m");
      const bool is_later = line.find("parseURDF") != std::string::npos ||
                            line.find("old deprecated") != std::string::npos;
      if (is_later) continue;  // formats that libsdformat tries after SDF
      if (place != std::string::npos && color != std::string::npos) return line.substr(color + 3);
    }
    return "";
  }

 private:
  std::ostringstream text_;
};

/// Returns the errors of a text that does not parse, without the elements around the first one and
/// without the text itself.
std::string parse_errors(const sdf::Errors& errors, const SdfMessages& messages) {
  std::string text = messages.first_error();
  bool has_element = false;
  for (const sdf::Error& error : errors) {
    const std::string& message = error.Message();
    const bool is_element = message.compare(0, 14, "Error reading ") == 0;
    const bool is_text = message.compare(0, 10, "Unable to ") == 0 &&
                         message.find("SDF string: ") != std::string::npos;
    if (is_text || (is_element && has_element)) continue;
    has_element = has_element || is_element;
    text += (text.empty() ? "" : "; ") + message;
  }
  while (!text.empty() && text.front() == ' ') text.erase(0, 1);
  return shortened(text.empty() ? "this is no SDF" : text, 400);
}

/// Returns a scoped name of SDF as a name of ROS: `arm::hand` becomes `arm/hand`.
std::string name_of_scoped(std::string name) {
  for (std::size_t at = name.find("::"); at != std::string::npos; at = name.find("::", at))
    name.replace(at, 2, "/");
  return name;
}

double limit_or_none(double limit) { return limit > 0.0 && limit < kUnlimited ? limit : 0.0; }

class SdfReader {
 public:
  explicit SdfReader(std::string folder) : folder_(std::move(folder)) {}

  SdfModel read(const std::string& text) {
    sdf::Root root;
    const sdf::Errors errors = load(text, &root);
    if (!errors.empty()) refuse("libsdformat rejects the SDF: " + parse_errors(errors, messages_));
    add_tops(root);
    if (tops_.empty()) refuse("the SDF has no <model>");
    result_.name = tops_.size() == 1 ? tops_[0]->Name() : root.WorldByIndex(0)->Name();
    for (const sdf::Model* top : tops_) {
      const std::string prefix = tops_.size() == 1 ? "" : name_of_scoped(top->Name()) + "/";
      add_model(*top, prefix, Isometry3d::Identity(), top->Static());
      ++top_;
    }
    return std::move(result_);
  }

 private:
  static sdf::Errors load(const std::string& text, sdf::Root* root) {
    const auto find_no_file = [](const std::string&) { return std::string(); };
    try {
#if SDF_MAJOR_VERSION >= 11
      sdf::ParserConfig config;
      config.SetFindCallback(find_no_file);
      return root->LoadSdfString(text, config);
#else
      sdf::setFindCallback(find_no_file);
      return root->LoadSdfString(text);
#endif
    } catch (const std::exception& error) {
      refuse("libsdformat fails to read a number or a name: " + shortened(error.what(), 300));
    }
  }

  void add_tops(const sdf::Root& root) {
    if (root.WorldCount() > 1) refuse("the SDF has more than one <world>");
    for (std::size_t w = 0; w < root.WorldCount(); ++w)
      for (std::size_t i = 0; i < root.WorldByIndex(w)->ModelCount(); ++i)
        tops_.push_back(root.WorldByIndex(w)->ModelByIndex(i));
#if SDF_MAJOR_VERSION >= 11
    if (root.Model() != nullptr) tops_.push_back(root.Model());
#else
    for (std::size_t i = 0; i < root.ModelCount(); ++i) tops_.push_back(root.ModelByIndex(i));
#endif
    if (root.WorldCount() == 0 && tops_.size() > 1)
      refuse("the SDF has more than one <model>: put them in a <world>");
  }

  /// `prefix` begins the names in the model; `parent` is the pose of the frame that it lies in.
  void add_model(const sdf::Model& model, const std::string& prefix, const Isometry3d& parent,
                 bool is_static) {
    const std::string owner = "model '" + shortened(model.Name(), 100) + "'";
    const Isometry3d pose = parent * pose_of_model(model, owner);
    for (std::size_t i = 0; i < model.LinkCount(); ++i) {
      const sdf::Link& given = *model.LinkByIndex(i);
      const std::string name = prefix + name_of_scoped(given.Name());
      SdfLink link;
      link.pose = pose * resolved_pose(given.SemanticPose(), "link '" + name + "'");
      link.link = read_sdf_link(given, name, is_static, folder_, &result_);
      link.model = top_;
      link.is_static = is_static;
      link.is_self_collide = sdf_flag(given.Element(), "self_collide", model.SelfCollide());
      result_.links.push_back(std::move(link));
    }
    if (is_static && model.JointCount() > 0)
      result_.warnings.push_back(owner + " is static: its joints are left out");
    for (std::size_t i = 0; !is_static && i < model.JointCount(); ++i)
      add_joint(model, *model.JointByIndex(i), prefix, pose);
    for (std::size_t i = 0; i < model.ModelCount(); ++i) {
      const sdf::Model& nested = *model.ModelByIndex(i);
      add_model(nested, prefix + name_of_scoped(nested.Name()) + "/", pose, is_static);
    }
  }

  static Isometry3d pose_of_model(const sdf::Model& model, const std::string& owner) {
#if SDF_MAJOR_VERSION < 11
    // does not resolve the pose of a model without a world
    if (model.PoseRelativeTo().empty()) return sdf_pose(model.RawPose(), owner);
#endif
    return resolved_pose(model.SemanticPose(), owner);
  }

  static void resolve_ends(const sdf::Model& model, const sdf::Joint& given, std::string* parent,
                           std::string* child) {
#if SDF_MAJOR_VERSION >= 11
    (void)model;
    check_sdf_errors(given.ResolveParentLink(*parent));
    check_sdf_errors(given.ResolveChildLink(*child));
#else
    *parent = given.ParentLinkName();
    *child = given.ChildLinkName();
    for (std::string* end : {parent, child})
      if (const sdf::Frame* frame = model.FrameByName(*end))
        check_sdf_errors(frame->ResolveAttachedToBody(*end));
#endif
  }

  void add_joint(const sdf::Model& model, const sdf::Joint& given, const std::string& prefix,
                 const Isometry3d& model_pose) {
    SdfJoint joint;
    joint.name = prefix + name_of_scoped(given.Name());
    const std::string owner = "joint '" + shortened(joint.name, 100) + "'";
    resolve_ends(model, given, &joint.parent, &joint.child);
    for (std::string* end : {&joint.parent, &joint.child})
      if (*end != "world") *end = prefix + name_of_scoped(*end);
    joint.frame = model_pose * resolved_pose(given.SemanticPose(), owner, "__model__");
    joint.kind = kind_of_sdf(given, owner);
    for (unsigned i = 0; i < 2; ++i)
      if (const sdf::JointAxis* axis = given.Axis(i))
        joint.axes.push_back(read_axis(*axis, given.Type(), owner));
    if (joint.kind == SdfJointKind::kGearbox) {
      joint.ratio = given.Element()->Get<double>("gearbox_ratio", 1.0).first;
      const std::string body =
          given.Element()->Get<std::string>("gearbox_reference_body", "").first;
      joint.reference_body = body == "world" ? body : prefix + name_of_scoped(body);
    } else if (joint.kind == SdfJointKind::kScrew) {
      joint.ratio = pitch_of(given, owner);
    }
    check_joint(joint, owner);
    result_.joints.push_back(std::move(joint));
  }

  static double pitch_of(const sdf::Joint& given, const std::string& owner) {
#if SDF_MAJOR_VERSION >= 13
    (void)owner;
    return given.ScrewThreadPitch();
#else
    if (given.Element()->HasElement("screw_thread_pitch"))
      refuse(owner + ": screw_thread_pitch: needs libsdformat 13; use thread_pitch");
    return -2.0 * engine::kPi / given.ThreadPitch();  // SDF: angle = −thread_pitch · translation
#endif
  }

  static SdfJointKind kind_of_sdf(const sdf::Joint& joint, const std::string& owner) {
    switch (joint.Type()) {
      case sdf::JointType::FIXED:
        return SdfJointKind::kFixed;
      case sdf::JointType::REVOLUTE:
      case sdf::JointType::CONTINUOUS:
        return SdfJointKind::kHinge;
      case sdf::JointType::PRISMATIC:
        return SdfJointKind::kSlider;
      case sdf::JointType::BALL:
        return SdfJointKind::kBall;
      case sdf::JointType::UNIVERSAL:
      case sdf::JointType::REVOLUTE2:
        return SdfJointKind::kUniversal;
      case sdf::JointType::SCREW:
        return SdfJointKind::kScrew;
      case sdf::JointType::GEARBOX:
        return SdfJointKind::kGearbox;
      default:
        refuse(owner + " has a type that is not known");
    }
  }

  SdfAxis read_axis(const sdf::JointAxis& given, sdf::JointType type, const std::string& owner) {
    auto direction = given.Xyz();
    check_sdf_errors(given.ResolveXyz(direction));
    SdfAxis axis;
    axis.direction = Vector3d(direction.X(), direction.Y(), direction.Z());
    if (type != sdf::JointType::CONTINUOUS) {
      if (!(given.Lower() <= -kUnlimited)) axis.lower = given.Lower();
      if (!(given.Upper() >= kUnlimited)) axis.upper = given.Upper();
    }
    axis.effort = limit_or_none(given.Effort());
    axis.velocity = limit_or_none(given.MaxVelocity());
    if (given.Effort() == 0.0)
      result_.warnings.push_back(owner + " has an effort limit of 0, which is none here");
    axis.damping = given.Damping();
    axis.friction = given.Friction();
    axis.spring = {given.SpringStiffness(), given.SpringReference()};
    return axis;
  }

  static void check_joint(const SdfJoint& joint, const std::string& owner) {
    const auto check = [&](double value, const char* field) {
      if (!std::isfinite(value))
        refuse(owner + ": " + field + ": must be finite, got " + std::to_string(value));
    };
    const auto check_law = [&](double value, const char* field) {
      check(value, field);
      if (value < 0.0)
        refuse(owner + ": " + field + ": must be >= 0, got " + std::to_string(value));
    };
    const std::size_t needed =
        joint.kind == SdfJointKind::kFixed || joint.kind == SdfJointKind::kBall          ? 0
        : joint.kind == SdfJointKind::kUniversal || joint.kind == SdfJointKind::kGearbox ? 2
                                                                                         : 1;
    if (joint.axes.size() < needed)
      refuse(owner + " needs " + (needed == 2 ? "<axis> and <axis2>" : "an <axis>"));
    check(joint.ratio, joint.kind == SdfJointKind::kScrew ? "thread_pitch" : "gearbox_ratio");
    for (const SdfAxis& axis : joint.axes) {
      if (std::isnan(axis.lower)) check(axis.lower, "lower");
      if (std::isnan(axis.upper)) check(axis.upper, "upper");
      check_law(axis.damping, "damping");
      check_law(axis.friction, "friction");
      check_law(axis.spring.stiffness, "spring_stiffness");
      check(axis.spring.rest, "spring_reference");
      if (!axis.direction.allFinite() || !(axis.direction.norm() > 0.0))
        refuse(owner + " has an axis without direction");
    }
  }

  std::string folder_;
  SdfMessages messages_;
  std::vector<const sdf::Model*> tops_;
  std::size_t top_ = 0;
  SdfModel result_;
};

}  // namespace

int sdformat_version() { return SDF_MAJOR_VERSION; }

SdfModel read_sdf_model(const std::string& text, const std::string& folder) {
  SdfModel model;
  // libsdformat parses a text that is no SDF as a URDF as well
  errors_logged_by([&] {
    try {
      model = SdfReader(folder).read(text);
    } catch (const sdf::Exception& error) {  // is no std::exception
      refuse("libsdformat fails: " + shortened(error.GetErrorStr(), 300));
    } catch (const std::invalid_argument&) {
      throw;
    } catch (const std::exception& error) {
      refuse("libsdformat fails: " + shortened(error.what(), 300));
    }
  });
  return model;
}

}  // namespace constraint_sim

#else

namespace constraint_sim {

int sdformat_version() { return 0; }

SdfModel read_sdf_model(const std::string& /*text*/, const std::string& /*folder*/) {
  refuse(
      "the text begins with <sdf>, and this program was built without libsdformat, which reads "
      "SDF; a URDF begins with <robot>");
}

}  // namespace constraint_sim

#endif
