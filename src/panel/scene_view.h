#pragma once

#include <QProcess>
#include <QString>
#include <functional>
#include <memory>
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
  ~SceneView() { give_up(); }
  SceneView(const SceneView&) = delete;
  SceneView& operator=(const SceneView&) = delete;

  /// Fits the view to the scene of this node, in place of a fit in progress.
  void frame(const std::string& node, rviz::DisplayContext* context);

 private:
  void give_up();
  void show(rviz::DisplayContext* context);

  std::function<void(bool success, const QString&)> say_;
  std::unique_ptr<QProcess> process_;
};

}  // namespace constraint_sim::panel
