#include "urdf/positions.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "constraint_sim/engine/joint.h"
#include "engine/model/mass_properties.h"
#include "urdf/parse.h"

namespace constraint_sim {
namespace {

[[noreturn]] void refuse_position(const std::string& joint, const std::string& why) {
  throw std::invalid_argument("urdf: joint '" + joint + "' " + why);
}

[[noreturn]] void refuse_given(const std::string& joint, const std::string& why) {
  throw std::invalid_argument("extra: positions: joint '" + joint + "' " + why);
}

class Positions {
 public:
  Positions(const urdf::ModelInterface& model, const std::map<std::string, double>& given,
            std::vector<std::string>* warnings)
      : model_(model), given_(given), warnings_(warnings) {
    for (const auto& entry : model.joints_)
      if (has_position(*entry.second)) of(*entry.second, 0);
  }

  std::map<std::string, double> take() { return std::move(found_); }

 private:
  double of(const urdf::Joint& joint, std::size_t depth) {
    const auto known = found_.find(joint.name);
    if (known != found_.end()) return known->second;
    if (depth > model_.joints_.size())
      refuse_position(joint.name, "mimics itself by way of others");
    double q = 0.0;
    const auto given = given_.find(joint.name);
    const bool is_given = given != given_.end();
    if (joint.mimic) {
      if (is_given) refuse_given(joint.name, "mimics another one; give the position of that");
      q = joint.mimic->offset + joint.mimic->multiplier * of(leader_of(model_, joint), depth + 1);
    } else if (is_given) {
      q = given->second;
    }
    return found_[joint.name] = within_limits(joint, q, is_given);
  }

  double within_limits(const urdf::Joint& joint, double q, bool is_given) {
    if (!joint.limits || joint.type == urdf::Joint::CONTINUOUS) return q;
    const urdf::JointLimits& limits = *joint.limits;
    if (!(limits.lower <= limits.upper))
      refuse_position(joint.name, "has a lower limit above the upper one");
    if (q >= limits.lower && q <= limits.upper) return q;
    if (is_given)
      refuse_given(joint.name, "must be from " + std::to_string(limits.lower) + " to " +
                                   std::to_string(limits.upper) + ", got " + std::to_string(q));
    if (joint.mimic)
      refuse_position(joint.name, "mimics a position beyond its own limits, " + std::to_string(q));
    const double nearest = std::clamp(q, limits.lower, limits.upper);
    warnings_->push_back("joint '" + joint.name + "' begins at " + std::to_string(nearest) +
                         ", since 0 is beyond its limits");
    return nearest;
  }

  const urdf::ModelInterface& model_;
  const std::map<std::string, double>& given_;
  std::vector<std::string>* warnings_;
  std::map<std::string, double> found_;
};

}  // namespace

bool has_position(const urdf::Joint& joint) {
  return joint.type == urdf::Joint::REVOLUTE || joint.type == urdf::Joint::CONTINUOUS ||
         joint.type == urdf::Joint::PRISMATIC;
}

Eigen::Quaterniond along_axis(const urdf::Joint& joint) {
  if (joint.type == urdf::Joint::FIXED) return Eigen::Quaterniond::Identity();
  const Eigen::Vector3d axis = to_eigen(joint.axis);
  if (!axis.allFinite() || !(axis.norm() > 0.0))
    refuse_position(joint.name, "has an axis without direction");
  return engine::frame_along(axis);
}

Eigen::Isometry3d motion_of(const urdf::Joint& joint,
                            const std::map<std::string, double>& positions) {
  Eigen::Isometry3d motion = Eigen::Isometry3d::Identity();
  if (!has_position(joint)) return motion;
  const Eigen::Vector3d axis = along_axis(joint) * Eigen::Vector3d::UnitZ();
  const double q = positions.at(joint.name);
  if (joint.type == urdf::Joint::PRISMATIC)
    motion.translation() = q * axis;
  else
    motion.linear() = engine::rotation(q * axis).toRotationMatrix();
  return motion;
}

const urdf::Joint& leader_of(const urdf::ModelInterface& model, const urdf::Joint& joint) {
  const auto leader = model.getJoint(joint.mimic->joint_name);
  if (!leader || !has_position(*leader))
    refuse_position(joint.name, "mimics '" + joint.mimic->joint_name +
                                    "', which is no revolute, continuous or prismatic joint");
  return *leader;
}

std::map<std::string, double> first_positions(const urdf::ModelInterface& model,
                                              const std::map<std::string, double>& given,
                                              std::vector<std::string>* warnings) {
  return Positions(model, given, warnings).take();
}

}  // namespace constraint_sim
