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

/// The view of rviz on a scene that is loaded while it runs: the one that `rviz_config --node`
/// finds, with grid and frames of its size. That runs in a process of its own, for it simulates
/// some seconds of the scene. Only an orbit view of the fixed frame is set: one that follows a
/// body stays.
class SceneView {
 public:
  /// `say` is told where the view stays, and why; and whether that is a failure.
  explicit SceneView(std::function<void(bool success, const QString&)> say)
      : say_(std::move(say)) {}
  ~SceneView() { give_up(); }
  SceneView(const SceneView&) = delete;
  SceneView& operator=(const SceneView&) = delete;

  /// Of the scene of this node, instead of one that is still looked for.
  void frame(const std::string& node, rviz::DisplayContext* context);

 private:
  void give_up();
  void show(rviz::DisplayContext* context);

  std::function<void(bool success, const QString&)> say_;
  std::unique_ptr<QProcess> process_;
};

}  // namespace constraint_sim::panel
