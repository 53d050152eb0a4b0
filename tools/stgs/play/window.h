// SPDX-License-Identifier: Apache-2.0
// A window with its keyboard and mouse input, and the ImGui context of its overlay.
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

// Mouse movement while a button was held.
struct Drag {
  double x = 0, y = 0;  // right and down, in screen coordinates
  bool held = false;    // the button is down, or was since the last call
};

// For the main thread only. At most one window exists at a time.
class Window {
 public:
  // kUnsupported without a display.
  static Result<std::unique_ptr<Window>> make(const std::string& title, Size size);
  ~Window();
  Window(const Window&) = delete;
  Window& operator=(const Window&) = delete;

  GLFWwindow* handle() const { return window_; }
  // Processes the input since the last call. Blocks up to `seconds` until there is some.
  void poll(double seconds);
  bool closing() const;
  void close();
  Size framebuffer_size() const;  // pixels; 0x0 if the window is minimised
  // Returns the keys pressed since the last call, including repeats of the arrow keys.
  std::vector<KeyPress> take_keys();
  bool is_down(int key) const;
  // Returns the drags since the last call, indexed by GLFW_MOUSE_BUTTON_LEFT, _RIGHT and _MIDDLE.
  // Clicks that begin and end between two frames count too.
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
  bool has_mouse_ = false;  // its position is known
};

}  // namespace stgs::tools
