#pragma once

#include <QLineEdit>
#include <QPushButton>
#include <QString>
#include <functional>

namespace constraint_sim::panel {

/// Makes a button that calls `clicked`. Its text, without the ampersand, is also its name for
/// screen readers and tests.
inline QPushButton* make_button(const QString& text, const QString& tip, QWidget* parent,
                                const std::function<void()>& clicked) {
  auto* const button = new QPushButton(text, parent);
  button->setToolTip(tip);
  button->setMinimumWidth(40);
  QObject::connect(button, &QPushButton::clicked, clicked);
  return button;
}

/// Names a widget that has no text, sets its tip, and returns it.
template <class Widget>
Widget* named(Widget* widget, const QString& name, const QString& tip) {
  widget->setAccessibleName(name);
  widget->setToolTip(tip);
  return widget;
}

}  // namespace constraint_sim::panel
