// SPDX-License-Identifier: Apache-2.0
// The Unity plugin in a host that imitates Unity: it loads the plugin by name, queues render events
// and texture updates for a render thread, and copies the pixels into textures whose first row is
// at the bottom.
#include <dlfcn.h>

#include <cmath>
#include <condition_variable>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <mutex>
#include <queue>
#include <thread>

#include "../fixtures/temporary_folder.h"
#include "../sdk/sdk_fixture.h"
#include "stgs_unity.h"

namespace stgs::testing {
namespace {

// The plugin's functions, found by name as DllImport does.
struct Plugin {
  void* library = ::dlopen(STGS_UNITY_PLUGIN, RTLD_NOW | RTLD_LOCAL);
  template <typename Function>
  Function* get(const char* name) const {
    REQUIRE(library != nullptr);
    void* symbol = ::dlsym(library, name);
    REQUIRE(symbol != nullptr);
    return reinterpret_cast<Function*>(symbol);
  }
  decltype(&stgs_unity_open) open = get<decltype(stgs_unity_open)>("stgs_unity_open");
  decltype(&stgs_unity_close) close = get<decltype(stgs_unity_close)>("stgs_unity_close");
  decltype(&stgs_unity_player) player = get<decltype(stgs_unity_player)>("stgs_unity_player");
  decltype(&stgs_unity_frame) frame = get<decltype(stgs_unity_frame)>("stgs_unity_frame");
  decltype(&stgs_unity_texture) texture = get<decltype(stgs_unity_texture)>("stgs_unity_texture");
  decltype(&stgs_unity_error) error = get<decltype(stgs_unity_error)>("stgs_unity_error");
  decltype(&UnityPluginUnload) unload = get<decltype(UnityPluginUnload)>("UnityPluginUnload");
  unity_event_fn render = get<decltype(stgs_unity_render_event)>("stgs_unity_render_event")();
  unity_event_and_data_fn update =
      get<decltype(stgs_unity_texture_event)>("stgs_unity_texture_event")();
};

struct Texture {
  std::uint32_t width, height;
  int format;
  std::vector<std::uint8_t> pixels = std::vector<std::uint8_t>(std::size_t{4} * width * height, 9);
  int updates = 0;
};

// Owns the render thread and its command queue.
class Host {
 public:
  ~Host() {
    push({});
    thread_.join();
    plugin.unload();
  }
  void render(std::int32_t handle) {
    push([this, handle] { plugin.render(handle); });
  }
  // Copies the plugin's pixels into a texture. Runs `before_copy` while the pixels are in use.
  void update(Texture& texture, std::uint32_t user, std::function<void()> before_copy = nullptr) {
    push([this, &texture, user, before_copy] {
      unity_texture_update update{};
      update.pixels = &update;  // invalid: the plugin must overwrite it
      update.user = user;
      update.format = texture.format;
      update.width = texture.width;
      update.height = texture.height;
      update.bytes_per_pixel = 4;
      plugin.update(UNITY_UPDATE_TEXTURE_BEGIN, &update);
      if (before_copy) before_copy();
      if (update.pixels != nullptr) {
        std::memcpy(texture.pixels.data(), update.pixels, texture.pixels.size());
        ++texture.updates;
      }
      plugin.update(UNITY_UPDATE_TEXTURE_END, &update);
    });
  }
  // Blocks until all queued commands have run.
  void finish() {
    std::mutex lock;
    std::condition_variable changed;
    bool done = false;
    push([&] {
      const std::scoped_lock locked(lock);
      done = true;
      changed.notify_one();
    });
    std::unique_lock locked(lock);
    changed.wait(locked, [&] { return done; });
  }
  // Waits until the file is open, updates a frame, and returns the player's state.
  std::int32_t wait_open(std::int32_t handle, const stgs_unity_camera& camera) {
    REQUIRE(stgs_player_wait_open(plugin.player(handle)) == STGS_OK);
    return plugin.frame(handle, 0, &camera, 1);
  }

  Plugin plugin;

 private:
  void push(std::function<void()> command) {
    const std::scoped_lock lock(mutex_);
    commands_.push(std::move(command));
    ready_.notify_one();
  }
  void run() {
    for (;;) {
      std::unique_lock lock(mutex_);
      ready_.wait(lock, [&] { return !commands_.empty(); });
      const std::function<void()> command = std::move(commands_.front());
      commands_.pop();
      lock.unlock();
      if (!command) return;
      command();
    }
  }

  std::mutex mutex_;
  std::condition_variable ready_;
  std::queue<std::function<void()>> commands_;
  std::thread thread_{[this] { run(); }};
};

// 4x4, row-major.
using Matrix = std::array<double, 16>;

Matrix product(const Matrix& a, const Matrix& b) {
  Matrix out{};
  for (int r = 0; r < 4; ++r) {
    for (int c = 0; c < 4; ++c) {
      for (int k = 0; k < 4; ++k) out[4 * r + c] += a[4 * r + k] * b[4 * k + c];
    }
  }
  return out;
}

void to_column_major(const Matrix& from, float (&out)[16]) {
  for (int r = 0; r < 4; ++r) {
    for (int c = 0; c < 4; ++c) out[4 * c + r] = static_cast<float>(from[4 * r + c]);
  }
}

// Returns the Unity camera that matches a view of the scene, if the scene is an object with a
// scale, a rotation about Unity's y axis, and a position.
stgs_unity_camera unity_camera(const stgs_view& view, double scale, double angle,
                               std::array<double, 3> position) {
  const double c = std::cos(angle), s = std::sin(angle);
  const Matrix object = {scale * c,  0, scale * s, position[0], 0, scale, 0, position[1],
                         -scale * s, 0, scale * c, position[2], 0, 0,     0, 1};
  const Matrix inverse = {
      c / scale, 0,         -s / scale, -(c * position[0] - s * position[2]) / scale,
      0,         1 / scale, 0,          -position[1] / scale,
      s / scale, 0,         c / scale,  -(s * position[0] + c * position[2]) / scale,
      0,         0,         0,          1};
  Matrix pose{};
  for (int r = 0; r < 3; ++r) {
    for (int k = 0; k < 3; ++k) pose[4 * r + k] = scale * view.rotation[3 * r + k];
    pose[4 * r + 3] = scale * view.translation[r];
  }
  pose[15] = 1;
  const Matrix camera_flip = {1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1};
  const Matrix scene_flip = {1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  stgs_unity_camera out{};
  to_column_major(object, out.local_to_world);
  to_column_major(product(product(camera_flip, pose), product(scene_flip, inverse)),
                  out.world_to_camera);
  const double n = scale * view.near_plane, f = 1000 * n, w = view.width, h = view.height;
  to_column_major(
      {2 * view.fx / w, 0, 1 - 2 * view.cx / w, 0, 0, 2 * view.fy / h, 2 * view.cy / h - 1, 0, 0, 0,
       -(f + n) / (f - n), -2 * f * n / (f - n), 0, 0, -1, 0},
      out.projection);
  out.width = view.width;
  out.height = view.height;
  return out;
}

// A temporary scene file.
struct File {
  std::vector<std::uint8_t> bytes = sdk_file();
  TemporaryFolder folder;
  std::string path = folder / "scene.stgs";
  File() {
    std::ofstream(path, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()),
               static_cast<std::streamsize>(bytes.size()));
  }
};

// Returns the number of bytes of a texture that differ from an image by more than `tolerance`.
std::size_t count_differences(const Texture& texture, const std::vector<std::uint8_t>& image,
                              int tolerance) {
  std::size_t count = 0;
  const std::size_t row = std::size_t{4} * texture.width;
  for (std::size_t y = 0; y < texture.height; ++y) {
    for (std::size_t x = 0; x < row; ++x) {
      const int difference =
          int{texture.pixels[y * row + x]} - int{image[(texture.height - 1 - y) * row + x]};
      count += std::abs(difference) > tolerance ? 1 : 0;
    }
  }
  return count;
}

}  // namespace

TEST_CASE("Unity textures receive the library's renders", "[unity]") {
  const File file;
  const ScenePtr scene = open_scene(file.bytes);
  const RendererPtr renderer = cpu_renderer();
  stgs_view view = start_view(scene.get());
  Host host;
  const std::int32_t handle = host.plugin.open(file.path.c_str(), 0, STGS_BACKEND_CPU);
  REQUIRE(handle > 0);
  // An object without a transform, and a scaled, rotated and moved one.
  const auto [scale, angle] = GENERATE(std::pair{1.0, 0.0}, std::pair{2.5, 0.7});
  stgs_unity_camera camera = unity_camera(view, scale, angle, {3 * angle, -2 * angle, angle});
  view.fovea_x = camera.fovea_x = 20;
  view.fovea_y = 14;
  camera.fovea_y = static_cast<float>(view.height) - 14;
  view.fovea_radius = camera.fovea_radius = 8;
  REQUIRE(host.wait_open(handle, camera) == STGS_PLAYER_PAUSED);
  REQUIRE(stgs_player_seek(host.plugin.player(handle), 0.4) == STGS_OK);
  stgs_player_status status{};
  for (int i = 1; status.is_complete == 0 && i < 10000; ++i) {
    status.struct_size = sizeof status;
    REQUIRE(stgs_player_update(host.plugin.player(handle), i, &status) == STGS_OK);
    std::this_thread::yield();
  }
  REQUIRE(host.plugin.frame(handle, 20000, &camera, 1) == STGS_PLAYER_PAUSED);
  Texture colour{view.width, view.height, UNITY_R8G8B8A8_SRGB};
  Texture depth{view.width, view.height, UNITY_R32_SFLOAT};
  host.render(handle);
  host.update(colour, host.plugin.texture(handle, 0, STGS_UNITY_COLOUR));
  host.update(depth, host.plugin.texture(handle, 0, STGS_UNITY_DEPTH));
  host.finish();
  char message[64];
  CHECK(host.plugin.error(handle, message, sizeof message) == STGS_OK);
  REQUIRE(colour.updates == 1);
  REQUIRE(depth.updates == 1);
  // Products of float matrices differ by rounding.
  CHECK(count_differences(colour, render_rgba8(renderer.get(), scene.get(), 0.4, view), 2) < 20);
  std::vector<float> expected(std::size_t{view.width} * view.height), actual(expected.size());
  stgs_image image = empty_image();
  image.depth = {expected.data(), 0, expected.size() * sizeof(float)};
  REQUIRE(stgs_render(renderer.get(), scene.get(), 0.4, &view, &image, 1) == STGS_OK);
  std::memcpy(actual.data(), depth.pixels.data(), depth.pixels.size());
  std::size_t wrong = 0, covered = 0;
  for (std::size_t i = 0; i < actual.size(); ++i) {
    const std::size_t flipped = (view.height - 1 - i / view.width) * view.width + i % view.width;
    wrong += std::abs(actual[i] - scale * expected[flipped]) > 0.01 * scale ? 1 : 0;
    covered += actual[i] > 0 ? 1 : 0;
  }
  CHECK(wrong < 20);
  CHECK(covered > 500);
}

TEST_CASE("unsuitable textures are not updated", "[unity]") {
  const File file;
  const ScenePtr scene = open_scene(file.bytes);
  const stgs_view view = start_view(scene.get());
  const stgs_unity_camera camera = unity_camera(view, 1, 0, {0, 0, 0});
  Host host;
  const std::int32_t handle = host.plugin.open(file.path.c_str(), 0, STGS_BACKEND_CPU);
  Texture early{view.width, view.height, UNITY_R8G8B8A8_UNORM};
  host.render(handle);  // no frame has been requested
  host.update(early, host.plugin.texture(handle, 0, 0));
  host.finish();
  REQUIRE(host.wait_open(handle, camera) == STGS_PLAYER_PAUSED);
  host.render(handle);
  Texture good{view.width, view.height, UNITY_R8G8B8A8_UNORM};
  Texture small{view.width, view.height - 1, UNITY_R8G8B8A8_UNORM};
  Texture other{view.width, view.height, UNITY_R32_SFLOAT};
  Texture not_rendered{view.width, view.height, UNITY_R8G8B8A8_UNORM}, unknown = not_rendered;
  host.update(good, host.plugin.texture(handle, 0, 0));
  host.update(small, host.plugin.texture(handle, 0, 0));
  host.update(other, host.plugin.texture(handle, 0, 0));
  host.update(not_rendered, host.plugin.texture(handle, 1, 0));
  host.update(unknown, host.plugin.texture(handle + 1, 0, 0));
  host.render(handle + 1);
  host.finish();
  CHECK(good.updates == 1);
  for (const Texture* texture : {&early, &small, &other, &not_rendered, &unknown}) {
    CHECK(texture->updates == 0);
  }
}

TEST_CASE("invalid cameras are rejected", "[unity]") {
  const File file;
  const stgs_view view = start_view(open_scene(file.bytes).get());
  Host host;
  const std::int32_t handle = host.plugin.open(file.path.c_str(), 0, STGS_BACKEND_CPU);
  const stgs_unity_camera good = unity_camera(view, 1, 0, {0, 0, 0});
  REQUIRE(host.plugin.frame(handle, 0, &good, 1) >= STGS_PLAYER_OPENING);
  const auto rejected = [&](const std::function<void(stgs_unity_camera&)>& change) {
    stgs_unity_camera camera = good;
    change(camera);
    return host.plugin.frame(handle, 0, &camera, 1) == -STGS_ERROR_ARGUMENT;
  };
  CHECK(rejected([](auto& c) { c.local_to_world[0] = 2; }));   // scales differ
  CHECK(rejected([](auto& c) { c.local_to_world[0] = -1; }));  // mirrored
  CHECK(rejected([](auto& c) { c.fovea_radius = -1; }));
  CHECK(rejected([](auto& c) { c.fovea_y = NAN; }));
  CHECK(rejected([](auto& c) { c.world_to_camera[3] = 1; }));  // not affine
  CHECK(rejected([](auto& c) { c.world_to_camera[0] = NAN; }));
  CHECK(rejected([](auto& c) { c.projection[11] = 0, c.projection[15] = 1; }));  // orthographic
  CHECK(host.plugin.frame(handle, 0, &good, 5) == -STGS_ERROR_ARGUMENT);
  CHECK(host.plugin.frame(handle, 0, nullptr, 1) == -STGS_ERROR_ARGUMENT);
  CHECK(host.plugin.frame(handle, NAN, &good, 1) == -STGS_ERROR_ARGUMENT);
  CHECK(host.plugin.frame(0, 0, &good, 1) == -STGS_ERROR_ARGUMENT);
  CHECK(host.plugin.frame(-7, 0, &good, 1) == -STGS_ERROR_ARGUMENT);
}

TEST_CASE("handles may be closed while the render thread works", "[unity]") {
  const File file;
  const stgs_view view = start_view(open_scene(file.bytes).get());
  const stgs_unity_camera camera = unity_camera(view, 1, 0, {0, 0, 0});
  Host host;
  Texture texture{view.width, view.height, UNITY_R8G8B8A8_UNORM};
  std::int32_t before = 0;
  for (int i = 0; i < 100; ++i) {
    const std::int32_t handle = host.plugin.open(file.path.c_str(), 1 << 20, STGS_BACKEND_CPU);
    REQUIRE(handle > 0);
    REQUIRE(handle != before);
    before = handle;
    if (i % 2 == 0) (void)host.wait_open(handle, camera);
    host.render(handle);
    const std::uint32_t user = host.plugin.texture(handle, 0, 0);
    // Every fourth handle is closed while Unity reads its image: the pixels stay valid until the
    // end of the update.
    host.update(texture, user,
                i % 4 == 0 ? std::function<void()>([&host, handle] { host.plugin.close(handle); })
                           : nullptr);
    if (i % 8 == 1) host.finish();
    if (i % 4 != 0) host.plugin.close(handle);
  }
  host.finish();
  CHECK(texture.updates >= 25);
  CHECK(host.plugin.player(before) == nullptr);
  host.plugin.close(before);                                         // no effect
  CHECK(host.plugin.open("no such file", 0, STGS_BACKEND_CPU) > 0);  // the player reports it
  CHECK(host.plugin.open(nullptr, 0, STGS_BACKEND_CPU) == -STGS_ERROR_ARGUMENT);
  CHECK(host.plugin.open("x", 0, 77) == -STGS_ERROR_ARGUMENT);
  int opened = 1;
  while (host.plugin.open("no such file", 0, STGS_BACKEND_CPU) > 0) ++opened;
  CHECK(opened == STGS_UNITY_MAX_HANDLES);
}

}  // namespace stgs::testing
