#pragma once

#include <QProcess>
#include <QString>
#include <functional>
#include <string>

namespace rviz {
class DisplayContext;
}

namespace constraint_sim::panel {

/// Fits rviz's view to a loaded scene, with grid and frames of its size, by `rviz_config --node`. A
/// separate process runs it, since it simulates some seconds of the scene. Only an orbit view in
/// the fixed frame is changed: one that follows a body stays.
class SceneView {
 public:
  /// `say` gets the reason why the view stays, and whether it is a failure.
  explicit SceneView(std::function<void(bool success, const QString&)> say)
      : say_(std::move(say)) {}
  ~SceneView();
  SceneView(const SceneView&) = delete;
  SceneView& operator=(const SceneView&) = delete;

  /// Fits the view to the scene of this node. A fit in progress ends first, without an effect: a
  /// process that is killed stays in the master's list of nodes.
  void frame(const std::string& node, rviz::DisplayContext* context);

 private:
  void start(rviz::DisplayContext* context);
  void show(rviz::DisplayContext* context);

  std::function<void(bool success, const QString&)> say_;
  QProcess process_;
  std::string wanted_;  // node whose scene is to be fitted next; empty: none
};

}  // namespace constraint_sim::panel
