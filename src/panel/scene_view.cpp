#include "panel/scene_view.h"

#include <rviz/config.h>
#include <rviz/display.h>
#include <rviz/display_context.h>
#include <rviz/display_group.h>
#include <rviz/properties/property.h>
#include <rviz/view_controller.h>
#include <rviz/view_manager.h>
#include <rviz/yaml_config_reader.h>

#include <csignal>
#include <utility>

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

SceneView::~SceneView() {
  if (process_.state() == QProcess::NotRunning) return;
  constexpr int kPatience = 1000;  // for the process to leave the master [ms]
  process_.disconnect();
  ::kill(static_cast<pid_t>(process_.processId()), SIGINT);
  if (process_.waitForFinished(kPatience)) return;
  process_.kill();
  process_.waitForFinished();
}

void SceneView::frame(const std::string& node, rviz::DisplayContext* context) {
  if (context == nullptr) return;  // shown outside of rviz
  wanted_ = node;
  if (process_.state() == QProcess::NotRunning) start(context);
}

void SceneView::start(rviz::DisplayContext* context) {
  process_.disconnect();
  const auto go_on = [this, context] {
    if (process_.state() != QProcess::NotRunning) return;  // started again meanwhile
    if (wanted_.empty())
      show(context);
    else
      start(context);
  };
  // queued, since the process may start again
  QObject::connect(&process_, QOverload<int, QProcess::ExitStatus>::of(&QProcess::finished),
                   &process_, go_on, Qt::QueuedConnection);
  process_.start(QString::fromStdString(program("rviz_config")),
                 {"--node", QString::fromStdString(std::exchange(wanted_, ""))},
                 QIODevice::ReadOnly);
}

void SceneView::show(rviz::DisplayContext* context) {
  if (process_.exitStatus() != QProcess::NormalExit || process_.exitCode() != 0)
    return say_(false, "view: " + QString::fromUtf8(process_.readAllStandardError()).trimmed());
  rviz::ViewController* const view = context->getViewManager()->getCurrent();
  if (view == nullptr) return;
  if (view->getClassId() != "rviz/Orbit") return say_(true, "the view stays: it is no orbit");
  const QString target = view->subProp("Target Frame")->getValue().toString();
  if (target != "<Fixed Frame>") return say_(true, "the view stays: it follows " + target);
  rviz::Config config;
  rviz::YamlConfigReader().readString(config, QString::fromUtf8(process_.readAllStandardOutput()));
  const rviz::Config manager = config.mapGetChild("Visualization Manager");
  view->load(manager.mapGetChild("Views").mapGetChild("Current"));
  const rviz::Config displays = manager.mapGetChild("Displays");
  resize(displays, "rviz/Grid", "Cell Size", context->getRootDisplayGroup());
  resize(displays, "rviz/TF", "Marker Scale", context->getRootDisplayGroup());
}

}  // namespace constraint_sim::panel
