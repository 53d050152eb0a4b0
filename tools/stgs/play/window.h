// SPDX-License-Identifier: Apache-2.0
// A window with what its viewer does in it, and an ImGui context for what is drawn over the scene.
#pragma once

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

 private:
  Window() = default;

  GLFWwindow* window_ = nullptr;
  bool has_glfw_ = false, has_overlay_ = false;
  std::vector<KeyPress> keys_;
};

}  // namespace stgs::tools
