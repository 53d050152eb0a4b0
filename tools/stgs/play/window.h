// SPDX-License-Identifier: Apache-2.0
// A window with what its viewer does in it, and an ImGui context for what is drawn over the scene.
#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "options.h"

struct GLFWwindow;

namespace stgs::tools {

struct KeyPress {
  int key = 0;  // GLFW_KEY_...
  bool shift = false;
};

// What the mouse did while a button was down.
struct Drag {
  double x = 0, y = 0;  // to the right and down, screen coordinates
  bool held = false;    // it is down, or was
};

// The main thread's. One at a time.
class Window {
 public:
  // kUnsupported where there is no display.
  static Result<std::unique_ptr<Window>> make(const std::string& title, Size size);
  ~Window();
  Window(const Window&) = delete;
  Window& operator=(const Window&) = delete;

  GLFWwindow* handle() const { return window_; }
  // Takes in what has happened since the last call; waits for it up to `seconds`.
  void look(double seconds);
  bool closing() const;
  void close();
  Size picture_size() const;  // pixels; 0x0 where nothing of it is shown
  // Keys that went down since the last call, and arrows that are held and repeat.
  std::vector<KeyPress> take_keys();
  bool is_down(int key) const;
  // Since the last call, in the order in which it happened: of the left, right and middle button
  // (GLFW_MOUSE_BUTTON_...), however much of it fell between two pictures.
  std::array<Drag, 3> take_drags();

 private:
  Window() = default;
  void listen_to_mouse();
  void on_button(int button, bool down);
  void on_motion(double x, double y);

  GLFWwindow* window_ = nullptr;
  bool has_glfw_ = false, has_overlay_ = false;
  std::vector<KeyPress> keys_;
  std::array<Drag, 3> drags_;
  std::array<bool, 3> down_ = {};
  double mouse_x_ = 0, mouse_y_ = 0;
  bool has_mouse_ = false;  // it has been seen
};

}  // namespace stgs::tools
