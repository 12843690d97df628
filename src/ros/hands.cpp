#include "ros/hands.h"

#include <ros/console.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <set>
#include <utility>
#include <vector>

#include "ros/conversions.h"
#include "ros/guarded.h"
#include "ros/marker_style.h"
#include "ros/time_conversions.h"
#include "sim/grip.h"
#include "sim/hand_edits.h"
#include "sim/words.h"

namespace constraint_sim {
namespace {

using interactive_markers::InteractiveMarkerServer;
using visualization_msgs::InteractiveMarker;
using visualization_msgs::InteractiveMarkerControl;
using visualization_msgs::InteractiveMarkerFeedback;
using visualization_msgs::Marker;

constexpr double kShowPeriod = 0.1;   // time between updates of marker poses [s]
constexpr double kDragPeriod = 0.05;  // time between updates of a drag's target [s]
constexpr double kIdle = 1.0;         // [s]
constexpr double kPush = 1.0;         // [m/s]
constexpr float kVeil = 0.02F;        // opacity of the clickable marker over the body itself
constexpr double kLargerThanBody = 1.02;

// Returns a frame without its leading slash, which old viewers send and tf2 rejects. Empty names
// are the world's frame.
std::string named_frame(const std::string& name, const std::string& world_frame) {
  if (name.empty() || name == "/") return world_frame;
  return name[0] == '/' ? name.substr(1) : name;
}

}  // namespace

Hands::Hands(const Parameters& parameters, const ros::NodeHandle& private_handle)
    : parameters_(parameters), private_handle_(private_handle) {
  if (!parameters_.hands) return;
  update_topic_ =
      private_handle_.advertise<visualization_msgs::InteractiveMarkerUpdate>("hands/update", 100);
  build_menu();
}

void Hands::start(Stepper* stepper) {
  const std::lock_guard<std::mutex> lock(mutex_);
  stepper_ = stepper;
}

void Hands::stop() {
  const std::lock_guard<std::mutex> lock(server_mutex_);
  stopped_ = true;
  server_.reset();  // joins its thread, whose edits are cancelled
}

bool Hands::anybody_looks() const {
  return parameters_.hands && update_topic_.getNumSubscribers() > 0;
}

std::string Hands::followed() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return followed_;
}

// ---- the menu

void Hands::build_menu() {
  add_entry("Fix here", [](World& world, const std::string& body) { fix(&world, body); });
  add_entry("Release", [](World& world, const std::string& body) { release(&world, body); });
  add_entry("Remove", [](World& world, const std::string& body) {
    world.remove_body(find_own_body(world, "body", body));
  });
  for (int axis = 0; axis < 3; ++axis)
    for (const double sign : {1.0, -1.0}) {
      const std::string title = std::string("Push along ") + (sign > 0.0 ? '+' : '-') + "xyz"[axis];
      add_entry(title.c_str(), [axis, sign](World& world, const std::string& body) {
        push(&world, body, kPush * sign * Eigen::Vector3d::Unit(axis));
      });
    }
  insert("Join: mark this body", [this](const std::string& body) { mark_for_joining(body); });
  insert("Join to the marked body", [this](const std::string& body) { join(body); });
  insert("Follow", [this](const std::string& body) {
    const std::lock_guard<std::mutex> lock(mutex_);
    followed_ = body;
  });
}

void Hands::insert(const std::string& title, const std::function<void(const std::string&)>& act) {
  menu_.insert(title, [title, act](const Feedback& feedback) {
    guarded("'" + title + "' of the menu", [&] { act(feedback->marker_name); });
  });
}

void Hands::add_entry(const char* title,
                      const std::function<void(World&, const std::string&)>& change) {
  insert(title, [this, title = std::string(title), change](const std::string& body) {
    post(title + " of " + body, [change, body](World& world) { change(world, body); });
  });
}

void Hands::mark_for_joining(const std::string& body) {
  const std::lock_guard<std::mutex> lock(mutex_);
  marked_ = body;
  ROS_INFO("'%s' is marked: 'Join to the marked body' of another one puts a rod between",
           marked_.c_str());
}

void Hands::join(const std::string& body) {
  std::string marked;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    marked = marked_;
  }
  if (marked.empty()) {
    ROS_WARN("no body is marked: 'Join: mark this body' of another one first");
    return;
  }
  post("join of " + body,
       [marked, body](World& world) { constraint_sim::join(&world, marked, body); });
}

// Queues a change. Errors go to the log: a viewer cannot show a response.
void Hands::post(const std::string& what, std::function<void(World&)> change) {
  Stepper* stepper = nullptr;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stepper = stepper_;
  }
  if (stepper == nullptr) return;
  guarded_post(*stepper, make_guard(what), std::move(change));
}

// ---- drags

// Handles a drag. A lagging viewer may still report a drag after another scene was loaded; a body
// of the new scene with the name of the dragged one is not dragged.
void Hands::on_feedback(const Feedback& feedback, engine::BodyId id) {
  const Eigen::Vector3d target = from_msg(feedback->pose.position);
  const std::string& body = feedback->marker_name;
  const std::string frame = named_frame(feedback->header.frame_id, parameters_.world_frame);
  if (frame != parameters_.world_frame) frames_.start(private_handle_);
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto drag = drags_.find(body);
  const double now = steady_now();
  auto pressed = pressed_.find(body);
  if (pressed != pressed_.end()) {
    const double last = std::exchange(pressed->second.last_feedback, now);
    if (now > last + kGone) {
      pressed_.erase(pressed);
      pressed = pressed_.end();
    }
  }
  const bool is_of_another = pressed != pressed_.end() && pressed->second.body != id;
  switch (feedback->event_type) {
    case InteractiveMarkerFeedback::MOUSE_DOWN:
      pressed_[body] = {id, now};  // a click without motion moves nothing
      break;
    case InteractiveMarkerFeedback::POSE_UPDATE:
      if (is_of_another) break;
      if (drag == drags_.end() || drag->second.frame != frame)
        drags_[body] = {id, frame, target, now, now};
      drags_[body].body = id;
      drags_[body].target = target;
      drags_[body].last_feedback = now;
      if (stepper_ != nullptr) stepper_->wake();
      break;
    case InteractiveMarkerFeedback::KEEP_ALIVE:
      if (drag != drags_.end() && !is_of_another) drag->second.last_feedback = now;
      break;
    case InteractiveMarkerFeedback::MOUSE_UP:
      pressed_.erase(body);
      if (drag != drags_.end()) drag->second.last_feedback = -kIdle;
      if (stepper_ != nullptr) stepper_->wake();
      break;
    default:
      break;
  }
}

// Returns the target in the world's frame. None while tf does not connect the drag's frame to the
// world's.
std::optional<Eigen::Vector3d> Hands::in_world(const Drag& drag) const {
  if (drag.frame == parameters_.world_frame) return drag.target;
  const auto pose = frames_.look_up(parameters_.world_frame, drag.frame, ros::Time(0));
  if (!pose) return std::nullopt;
  return from_msg(pose->translation) + from_msg(pose->rotation).normalized() * drag.target;
}

void Hands::warn_of_frame(const std::string& body, const Drag& drag) {
  feedback_guard_.warn("the drag of '" + shortened(body) +
                       "' is refused: tf has no transform from '" + shortened(drag.frame) +
                       "' to '" + parameters_.world_frame + "'");
}

double Hands::passed() {
  if (!parameters_.hands) return kIdle;
  const double now = steady_now();
  struct Held {
    engine::BodyId body;
    Eigen::Vector3d target;  // in the world's frame [m]
  };
  std::map<std::string, Held> held;
  std::vector<std::string> released;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (drags_.empty()) return kIdle;
    if (now < last_drag_ + kDragPeriod) return last_drag_ + kDragPeriod - now;
    last_drag_ = now;
    for (auto drag = drags_.begin(); drag != drags_.end();) {
      const bool is_over = now > drag->second.last_feedback + kPatience;
      const std::optional<Eigen::Vector3d> target = in_world(drag->second);
      drag->second.was_placed = drag->second.was_placed || target;
      if (!target && (is_over ? !drag->second.was_placed : now > drag->second.begin + kPatience))
        warn_of_frame(drag->first, drag->second);
      if (is_over)
        released.push_back(drag->first);
      else if (target)
        held[drag->first] = {drag->second.body, *target};
      drag = is_over ? drags_.erase(drag) : std::next(drag);
    }
  }
  for (const std::string& body : released)
    post("release of " + body, [body](World& world) { let_go(&world, body); });
  for (const auto& [body, held_drag] : held)
    post("drag of " + body, [body = body, drag_of = held_drag](World& world) {
      // skip bodies that were removed, or replaced by another scene's
      if (world.has_body(body) && world.find_body(body) == drag_of.body)
        drag(&world, body, drag_of.target);
    });
  return kDragPeriod;
}

void Hands::edited(const World& world) {
  if (!parameters_.hands) return;
  std::set<std::string> left;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    for (const engine::JointId id : world.joint_ids()) {
      const engine::Joint& joint = world.joint(id);
      if (!is_grip(joint)) continue;
      const std::string& body = world.body(joint.body_b).name;
      if (drags_.count(body) == 0) left.insert(body);
    }
  }
  for (const std::string& body : left)
    post("release of " + body, [body](World& w) { let_go(&w, body); });
}

// ---- markers

void Hands::show(const World& world) {
  const std::lock_guard<std::mutex> lock(server_mutex_);
  if (stopped_) return;
  if (!anybody_looks()) {
    server_.reset();
    shown_.clear();
    return;
  }
  const double now = steady_now();
  if (server_ && now < last_shown_ + kShowPeriod) return;
  last_shown_ = now;
  if (!server_)
    server_ = std::make_unique<InteractiveMarkerServer>(private_handle_.resolveName("hands"),
                                                        ros::this_node::getName(), true);
  std::map<std::string, std::uint32_t> present;
  for (const engine::BodyId id : world.body_ids()) {
    if (world.body(id).type != engine::BodyType::kDynamic) continue;
    if (present.size() == kMost) {
      if (!std::exchange(told_of_most_, true))
        ROS_WARN("only the first %zu dynamic bodies can be dragged in rviz", kMost);
      break;
    }
    present[world.body(id).name] = id.value;
    show_body(world, id);
  }
  for (const auto& [name, id] : shown_)
    if (present.count(name) == 0) server_->erase(name);
  shown_ = std::move(present);
  server_->applyChanges();
}

void Hands::show_body(const World& world, engine::BodyId id) {
  const engine::Body& body = world.body(id);
  const auto known = shown_.find(body.name);
  if (known != shown_.end() && known->second == id.value) {
    std_msgs::Header header;
    header.frame_id = parameters_.world_frame;
    server_->setPose(body.name, to_pose(world.state(id)), header);
    return;
  }
  InteractiveMarkerControl control;
  control.name = "drag";
  control.interaction_mode = InteractiveMarkerControl::MOVE_3D;
  control.always_visible = true;
  float scale = 0.0F;
  for (std::size_t part = 0; part < engine::part_count(body.shape); ++part) {
    Marker& veil = control.markers.emplace_back();
    veil.color = body_colour(body);
    veil.color.a = kVeil;
    set_shape(&veil, engine::part_of(body.shape, static_cast<int>(part)));
    veil.scale.x *= kLargerThanBody;
    veil.scale.y *= kLargerThanBody;
    veil.scale.z *= kLargerThanBody;
    const engine::ShapePose pose = pose_of_part(body, part);
    veil.pose = to_pose({pose.position, pose.orientation});
    scale =
        std::max(scale, static_cast<float>(std::max({veil.scale.x, veil.scale.y, veil.scale.z})));
  }
  InteractiveMarker marker;
  marker.header.frame_id = parameters_.world_frame;
  marker.header.stamp = ros::Time(0);  // stamp 0: the pose holds at any time
  marker.name = body.name;
  marker.description = "";
  marker.pose = to_pose(world.state(id));
  marker.scale = scale;
  marker.controls.push_back(control);
  server_->insert(marker, [this, id](const Feedback& feedback) {
    feedback_guard_([&] { on_feedback(feedback, id); });
  });
  menu_.apply(*server_, body.name);
}

}  // namespace constraint_sim
