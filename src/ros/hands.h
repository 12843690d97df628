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

/// Bodies that are dragged with the mouse in rviz, and have a menu: interactive markers below
/// `hands`. A drag is a force (sim/grip.h) that ends with the mouse button, and where feedback
/// stops for kPatience. Edits are queued as those of services are. Without a viewer there is no
/// server and no marker. A pointer in another frame than the world's is where tf has that frame;
/// one in a frame that tf does not connect to the world's moves nothing, and is a warning.
class Hands {
 public:
  static constexpr double kPatience = 0.5;  ///< [s] without feedback
  /// [s] without feedback after which a viewer that never said MOUSE_UP is gone
  static constexpr double kGone = 10.0;
  static constexpr std::size_t kMost = 200;  ///< dynamic bodies with a marker, the first ones

  Hands(const Parameters& parameters, const ros::NodeHandle& private_handle);
  /// Queues edits there from now on, until stop().
  void start(Stepper* stepper);
  /// The stepper must have stopped.
  void stop();

  /// Whether a viewer is there. On any thread.
  bool anybody_looks() const;
  /// The body that viewers follow, or none. On any thread.
  std::string followed() const;

  /// Shows bodies where they are. On the publishing thread.
  void show(const World& world);

  // ---- on the stepping thread
  /// Lets go of what nobody drags, as in a scene that was saved meanwhile.
  void edited(const World& world);
  /// Answers after how many seconds it has something to do again.
  double passed();

 private:
  using Feedback = visualization_msgs::InteractiveMarkerFeedbackConstPtr;
  struct Press {
    engine::BodyId body;
    double last_feedback;  ///< of the steady clock [s]
  };
  struct Drag {
    engine::BodyId body;  ///< another body may come under the same name
    std::string frame;    ///< frame in which the target is given
    Eigen::Vector3d target;
    double begin, last_feedback;  ///< of the steady clock [s]
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
  ros::Publisher update_topic_;  // of the server, here to count who looks
  Frames frames_;                // from the first pointer in another frame on
  Guard feedback_guard_{"hands/feedback"};

  mutable std::mutex mutex_;  // of all below
  Stepper* stepper_ = nullptr;
  std::map<std::string, Drag> drags_;     // by body
  std::map<std::string, Press> pressed_;  // what the button went down on
  std::string marked_, followed_;
  double last_drag_ = 0.0;  // steady clock [s]

  // of the publishing thread
  interactive_markers::MenuHandler menu_;
  std::map<std::string, std::uint32_t> shown_;  // ids by name
  double last_shown_ = 0.0;                     // steady clock [s]
  bool told_of_most_ = false;
  std::mutex server_mutex_;  // against stop()
  bool stopped_ = false;
  std::unique_ptr<interactive_markers::InteractiveMarkerServer> server_;
};

}  // namespace constraint_sim
