// SPDX-License-Identifier: Apache-2.0
#include "play/window.h"

#include <GLFW/glfw3.h>
#include <backends/imgui_impl_glfw.h>
#include <imgui.h>

#include <algorithm>
#include <utility>

namespace stgs::tools {
namespace {

// The last GLFW error. GLFW reports errors to a callback without user data.
std::string& last_error() {
  static std::string text;
  return text;
}

void on_error(int, const char* text) {
  last_error() = text;
}

// Returns whether a held key repeats.
bool repeats(int key) {
  return key == GLFW_KEY_LEFT || key == GLFW_KEY_RIGHT || key == GLFW_KEY_UP ||
         key == GLFW_KEY_DOWN;
}

}  // namespace

Result<std::unique_ptr<Window>> Window::make(const std::string& title, Size size) {
  std::unique_ptr<Window> made(new Window);
  last_error().clear();
  glfwSetErrorCallback(on_error);
  if (glfwInit() == GLFW_FALSE) {
    return unsupported(
        "cannot open a window ({}); run 'stgs play' in a desktop session, or use 'stgs render'",
        last_error());
  }
  made->has_glfw_ = true;
  glfwWindowHint(GLFW_CLIENT_API, GLFW_NO_API);
  made->window_ = glfwCreateWindow(size.width, size.height, title.c_str(), nullptr, nullptr);
  if (made->window_ == nullptr) return unsupported("cannot open a window ({})", last_error());
  glfwSetWindowUserPointer(made->window_, made.get());
  glfwSetKeyCallback(made->window_, [](GLFWwindow* window, int key, int, int action, int mods) {
    if (action == GLFW_RELEASE || (action == GLFW_REPEAT && !repeats(key))) return;
    static_cast<Window*>(glfwGetWindowUserPointer(window))
        ->keys_.push_back({key, (mods & GLFW_MOD_SHIFT) != 0});
  });
  made->listen_to_mouse();
  IMGUI_CHECKVERSION();
  ImGui::CreateContext();
  ImGui::StyleColorsDark();
  ImGuiIO& io = ImGui::GetIO();
  io.IniFilename = nullptr;  // do not write imgui.ini
  io.BackendFlags |= ImGuiBackendFlags_RendererHasVtxOffset;
  float scale = 1, unused = 1;
  glfwGetWindowContentScale(made->window_, &scale, &unused);
  ImFontConfig font;
  font.SizePixels = 13.0f * std::max(scale, 1.0f);
  io.Fonts->AddFontDefault(&font);
  ImGui::GetStyle().ScaleAllSizes(std::max(scale, 1.0f));
  ImGui_ImplGlfw_InitForVulkan(made->window_, true);  // chains the callbacks set above
  made->has_overlay_ = true;
  return made;
}

Window::~Window() {
  if (has_overlay_) {
    ImGui_ImplGlfw_Shutdown();
    ImGui::DestroyContext();
  }
  if (window_ != nullptr) glfwDestroyWindow(window_);
  if (has_glfw_) glfwTerminate();
}

void Window::listen_to_mouse() {
  glfwSetMouseButtonCallback(window_, [](GLFWwindow* window, int button, int action, int) {
    static_cast<Window*>(glfwGetWindowUserPointer(window))
        ->on_button(button, action != GLFW_RELEASE);
  });
  glfwSetCursorPosCallback(window_, [](GLFWwindow* window, double x, double y) {
    static_cast<Window*>(glfwGetWindowUserPointer(window))->on_motion(x, y);
  });
}

void Window::on_button(int button, bool down) {
  const auto i = static_cast<std::size_t>(button);
  if (i >= drags_.size()) return;
  down_[i] = down;
  drags_[i].held = drags_[i].held || down;
}

void Window::on_motion(double x, double y) {
  for (std::size_t i = 0; i < drags_.size() && has_mouse_; ++i) {
    if (!down_[i]) continue;
    drags_[i].x += x - mouse_x_;
    drags_[i].y += y - mouse_y_;
  }
  mouse_x_ = x;
  mouse_y_ = y;
  has_mouse_ = true;
}

void Window::poll(double seconds) {
  if (seconds > 0) {
    glfwWaitEventsTimeout(seconds);
  } else {
    glfwPollEvents();
  }
}

bool Window::closing() const {
  return glfwWindowShouldClose(window_) != GLFW_FALSE;
}

void Window::close() {
  glfwSetWindowShouldClose(window_, GLFW_TRUE);
}

Size Window::framebuffer_size() const {
  Size size;
  glfwGetFramebufferSize(window_, &size.width, &size.height);
  return size;
}

std::vector<KeyPress> Window::take_keys() {
  return std::exchange(keys_, {});
}

std::array<Drag, 3> Window::take_drags() {
  std::array<Drag, 3> taken = drags_;
  for (std::size_t i = 0; i < drags_.size(); ++i) drags_[i] = {0, 0, down_[i]};
  return taken;
}

bool Window::is_down(int key) const {
  return glfwGetKey(window_, key) == GLFW_PRESS;
}

}  // namespace stgs::tools
