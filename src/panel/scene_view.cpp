#include "panel/scene_view.h"

#include <rviz/config.h>
#include <rviz/display.h>
#include <rviz/display_context.h>
#include <rviz/display_group.h>
#include <rviz/properties/property.h>
#include <rviz/view_controller.h>
#include <rviz/view_manager.h>
#include <rviz/yaml_config_reader.h>

#include "panel/programs.h"

namespace constraint_sim::panel {
namespace {

// Sets the size of displays of this kind to that of the scene, as rviz_config computes it.
void resize(const rviz::Config& displays, const QString& kind, const QString& size,
            rviz::DisplayGroup* group) {
  for (int i = 0; i < displays.listLength(); ++i) {
    QString of;
    if (!displays.listChildAt(i).mapGetString("Class", &of) || of != kind) continue;
    for (int j = 0; j < group->numDisplays(); ++j)
      if (group->getDisplayAt(j)->getClassId() == kind)
        group->getDisplayAt(j)->subProp(size)->load(displays.listChildAt(i).mapGetChild(size));
  }
}

}  // namespace

void SceneView::frame(const std::string& node, rviz::DisplayContext* context) {
  give_up();
  process_ = std::make_unique<QProcess>();
  QObject::connect(process_.get(), QOverload<int, QProcess::ExitStatus>::of(&QProcess::finished),
                   [this, context] { show(context); });
  process_->start(QString::fromStdString(program("rviz_config")),
                  {"--node", QString::fromStdString(node)}, QIODevice::ReadOnly);
}

void SceneView::give_up() {
  if (!process_) return;
  process_->disconnect();
  process_->kill();
  process_->waitForFinished();
}

void SceneView::show(rviz::DisplayContext* context) {
  if (process_->exitStatus() != QProcess::NormalExit || process_->exitCode() != 0)
    return say_(false, "view: " + QString::fromUtf8(process_->readAllStandardError()).trimmed());
  rviz::ViewController* const view = context->getViewManager()->getCurrent();
  if (view == nullptr) return;
  if (view->getClassId() != "rviz/Orbit") return say_(true, "the view stays: it is no orbit");
  const QString target = view->subProp("Target Frame")->getValue().toString();
  if (target != "<Fixed Frame>") return say_(true, "the view stays: it follows " + target);
  rviz::Config config;
  rviz::YamlConfigReader().readString(config, QString::fromUtf8(process_->readAllStandardOutput()));
  const rviz::Config manager = config.mapGetChild("Visualization Manager");
  view->load(manager.mapGetChild("Views").mapGetChild("Current"));
  const rviz::Config displays = manager.mapGetChild("Displays");
  resize(displays, "rviz/Grid", "Cell Size", context->getRootDisplayGroup());
  resize(displays, "rviz/TF", "Marker Scale", context->getRootDisplayGroup());
}

}  // namespace constraint_sim::panel
