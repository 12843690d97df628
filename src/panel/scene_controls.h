#pragma once

#include <QComboBox>
#include <QLineEdit>
#include <QWidget>

#include "panel/client.h"

namespace constraint_sim::panel {

/// Controls to load a scene, and to save one to a file.
class SceneControls : public QWidget {
 public:
  SceneControls(Client& client, QWidget* parent);

  /// Requests the list of scenes from the node.
  void refresh();
  QString scene() const { return scenes_->currentText(); }
  QString file() const { return file_->text(); }
  void set(const QString& scene, const QString& file);
  /// Shows the name of the scene that runs, unless the user is typing another one.
  void show_running(const QString& scene);

 private:
  void load();
  void save();

  Client& client_;
  QComboBox* scenes_;
  QLineEdit* file_;
};

}  // namespace constraint_sim::panel
