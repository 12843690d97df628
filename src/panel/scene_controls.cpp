#include "panel/scene_controls.h"

#include <constraint_sim/ListScenes.h>
#include <constraint_sim/LoadScene.h>
#include <constraint_sim/SaveScene.h>

#include <QGridLayout>
#include <QLabel>

#include "panel/widgets.h"

namespace constraint_sim::panel {

SceneControls::SceneControls(Client& client, QWidget* parent) : QWidget(parent), client_(client) {
  scenes_ = named(new QComboBox(this), "Scene",
                  "A scene of the package, a path on the machine of the node, or package://");
  scenes_->setEditable(true);
  scenes_->setInsertPolicy(QComboBox::NoInsert);
  scenes_->setMinimumContentsLength(8);
  scenes_->setSizeAdjustPolicy(QComboBox::AdjustToMinimumContentsLengthWithIcon);
  scenes_->lineEdit()->setAccessibleName("Scene name");
  file_ = named(new QLineEdit("scene.yaml", this), "Scene file",
                "Where Save writes the world as a scene, on the machine of the node");

  auto* const grid = new QGridLayout(this);
  grid->setContentsMargins(0, 0, 0, 0);
  grid->setColumnStretch(1, 1);
  grid->addWidget(new QLabel("Scene", this), 0, 0);
  grid->addWidget(scenes_, 0, 1);
  grid->addWidget(make_button("L&oad", "load_scene", this, [this] { load(); }), 0, 2);
  grid->addWidget(new QLabel("File", this), 1, 0);
  grid->addWidget(file_, 1, 1);
  grid->addWidget(make_button("Sa&ve", "save_scene", this, [this] { save(); }), 1, 2);
}

void SceneControls::set(const QString& scene, const QString& file) {
  scenes_->setEditText(scene);
  file_->setText(file);
}

void SceneControls::show_running(const QString& scene) {
  const QLineEdit& edit = *scenes_->lineEdit();
  if (!edit.hasFocus() && !edit.isModified()) scenes_->setEditText(scene);
}

void SceneControls::refresh() {
  client_.poll<ListScenes>("list_scenes", ListScenesRequest(), [this](const auto& response) {
    // The list may arrive while the user types.
    const QLineEdit& edit = *scenes_->lineEdit();
    const QString text = edit.text();
    const bool is_modified = edit.isModified();
    const int cursor = edit.cursorPosition(), begin = edit.selectionStart();
    const int length = static_cast<int>(edit.selectedText().size());
    scenes_->clear();
    for (std::size_t i = 0; i < response.scenes.size(); ++i) {
      scenes_->addItem(QString::fromStdString(response.scenes[i]));
      if (i < response.descriptions.size())
        scenes_->setItemData(static_cast<int>(i), QString::fromStdString(response.descriptions[i]),
                             Qt::ToolTipRole);
    }
    scenes_->setEditText(text);
    scenes_->lineEdit()->setModified(is_modified);
    const bool is_cursor_first = cursor == begin;  // true after inline completion
    scenes_->lineEdit()->setCursorPosition(cursor);
    if (length > 0 && is_cursor_first) scenes_->lineEdit()->setSelection(begin + length, -length);
    if (length > 0 && !is_cursor_first) scenes_->lineEdit()->setSelection(begin, length);
  });
}

void SceneControls::load() {
  LoadSceneRequest request;
  request.path = scenes_->currentText().toStdString();
  scenes_->lineEdit()->setModified(false);
  client_.call<LoadScene>(Queue::kEdits, "load_scene", request.path, request);
}

void SceneControls::save() {
  SaveSceneRequest request;
  request.path = file_->text().toStdString();
  if (request.path.empty())
    request.path = ".";  // an empty path only returns the text; the node rejects `.` with a message
  client_.call<SaveScene>(Queue::kQueries, "save_scene", request.path, request);
}

}  // namespace constraint_sim::panel
