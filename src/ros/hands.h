#pragma once

#include <interactive_markers/interactive_marker_server.h>
#include <interactive_markers/menu_handler.h>
#include <ros/node_handle.h>
#include <ros/publisher.h>

#include <atomic>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "ros/frames.h"
#include "ros/guarded.h"
#include "ros/parameters.h"
#include "sim/stepper.h"

namespace constraint_sim {

/// Interactive markers below `hands`, by which bodies are dragged with the mouse in rviz and have a
/// menu. A drag is a force (sim/grip.h) that ends with the mouse button, or after kPatience without
/// feedback. Edits are queued like those of services. Without a viewer there is no server and no
/// marker. tf transforms the pointer to the world's frame; a pointer in an unconnected frame moves
/// nothing and is a warning.
class Hands {
 public:
  static constexpr double kPatience = 0.5;  ///< time without feedback that ends a drag [s]
  /// Time without feedback after which a viewer is taken to have quit without MOUSE_UP [s].
  static constexpr double kGone = 10.0;
  static constexpr std::size_t kMost =
      200;  ///< number of dynamic bodies with a marker, the first ones

  Hands(const Parameters& parameters, const ros::NodeHandle& private_handle);
  /// Queues edits at `stepper` until stop().
  void start(Stepper* stepper);
  /// Requires that the stepper has stopped.
  void stop();

  /// Returns whether a viewer is connected. Any thread.
  bool anybody_looks() const;
  /// Returns the body that viewers follow, or an empty name. Any thread.
  std::string followed() const;

  /// Updates the markers. Publishing thread only.
  void show(const World& world);

  // ---- stepping thread
  /// Releases bodies that no viewer drags, as in a scene that was saved during a drag.
  void edited(const World& world);
  /// Moves drags on; returns the time until the next call [s].
  double passed();

 private:
  using Feedback = visualization_msgs::InteractiveMarkerFeedbackConstPtr;
  struct Press {
    engine::BodyId body;
    double last_feedback;  ///< time of the last feedback, by the steady clock [s]
  };
  struct Drag {
    engine::BodyId body;  ///< tells another body of that name apart
    std::string frame;    ///< frame in which the target is given
    Eigen::Vector3d target;
    double begin, last_feedback;  ///< steady clock [s]
    bool was_placed = false;      ///< the target has been found in the world's frame
  };

  void build_menu();
  void add_entry(const char* title, const std::function<void(World&, const std::string&)>& change);
  void on_feedback(const Feedback& feedback, engine::BodyId id);
  std::optional<Eigen::Vector3d> in_world(const Drag& drag) const;
  void warn_of_frame(const std::string& body, const Drag& drag);
  void insert(const std::string& title, const std::function<void(const std::string&)>& act);
  void mark_for_joining(const std::string& body);
  void join(const std::string& body);
  void post(const std::string& what, std::function<void(World&)> change);
  void show_body(const World& world, engine::BodyId id);

  Parameters parameters_;
  ros::NodeHandle private_handle_;
  ros::Publisher update_topic_;  // topic of server_, advertised here too, to count its subscribers
  Frames frames_;                // started by the first pointer in another frame
  Guard feedback_guard_{"hands/feedback"};

  mutable std::mutex mutex_;  // protects the members down to last_drag_
  Stepper* stepper_ = nullptr;
  std::map<std::string, Drag> drags_;     // by body name
  std::map<std::string, Press> pressed_;  // bodies under a pressed mouse button, by name
  std::string marked_, followed_;
  double last_drag_ = 0.0;  // steady clock [s]

  // publishing thread only
  interactive_markers::MenuHandler menu_;
  std::map<std::string, std::uint32_t> shown_;  // body ids by name
  double last_shown_ = 0.0;                     // steady clock [s]
  bool told_of_most_ = false;
  std::mutex server_mutex_;  // protects the server from stop()
  bool stopped_ = false;
  std::unique_ptr<interactive_markers::InteractiveMarkerServer> server_;
};

}  // namespace constraint_sim
