// SPDX-License-Identifier: Apache-2.0
#include "renderer.h"

#include <new>
#include <utility>

#include "image.h"
#include "scene.h"
#include "structs.h"
#include "view.h"

using stgs::sdk::guarded;
using stgs::sdk::Outcome;

namespace {

// Index: stgs_backend.
constexpr const char* kBackends[] = {"auto", "cpu", "cuda", "vulkan"};

stgs_renderer_settings default_renderer_settings() {
  stgs_renderer_settings settings{};
  settings.struct_size = sizeof(settings);
  settings.backend = STGS_BACKEND_AUTO;
  return settings;
}

Outcome make_backend(stgs_renderer& renderer, stgs_backend backend) {
  if (backend < STGS_BACKEND_AUTO || backend > STGS_BACKEND_VULKAN) {
    return {STGS_ERROR_ARGUMENT, fmt::format("settings: unknown backend {}", backend)};
  }
  auto created = stgs::player::make_renderer(kBackends[backend]);
  if (!created.ok()) return created.status();
  renderer.backend = std::move(created).value();
  renderer.log(STGS_LOG_INFO, fmt::format("rendering with backend '{}'", renderer.backend->name()));
  return {};
}

}  // namespace

namespace stgs::sdk {

stgs_result create_renderer(const stgs_renderer_settings* settings, stgs_renderer** out,
                            const std::function<Outcome(stgs_renderer&, stgs_backend)>& make) {
  if (out == nullptr) return STGS_ERROR_ARGUMENT;
  *out = nullptr;
  stgs_renderer_settings known = default_renderer_settings();
  if (settings != nullptr) {
    if (const stgs_result bad = copy_in(settings, known); bad != STGS_OK) return bad;
  }
  const Log log = {known.log, known.log_user};
  if (const stgs_result bad = check_task_runner(known.task_runner, log); bad != STGS_OK) return bad;
  std::unique_ptr<stgs_renderer> renderer(new (std::nothrow) stgs_renderer);
  if (renderer == nullptr) return STGS_ERROR_OUT_OF_MEMORY;
  renderer->log = log;
  renderer->measure = known.measure != 0;
  const stgs_result result = guarded(renderer.get(), [&]() -> Outcome {
    renderer->tasks = caller_tasks(known.task_runner);
    Outcome created = make(*renderer, known.backend);
    if (created.result != STGS_OK) renderer->log(STGS_LOG_ERROR, created.status.message());
    return created;
  });
  if (result == STGS_OK) *out = renderer.release();
  return result;
}

Outcome clamp_time(const stgs_scene* scene, double& seconds) {
  if (scene == nullptr) return {STGS_ERROR_ARGUMENT, "scene is NULL"};
  STGS_SDK_TRY(scene->check_open());
  return scene->clamp_time(seconds);
}

Outcome copy_in_views(stgs_renderer& renderer, const stgs_view* views, std::uint32_t count) {
  if (count < 1 || count > STGS_MAX_VIEWS) {
    return {STGS_ERROR_ARGUMENT,
            fmt::format("count is {} (expected 1 to {} views)", count, STGS_MAX_VIEWS)};
  }
  if (views == nullptr) return {STGS_ERROR_ARGUMENT, "views is NULL"};
  std::array<stgs_view, STGS_MAX_VIEWS> known;
  known.fill(default_view());
  STGS_SDK_TRY(copy_in_array(views, std::span(known).first(count), "views"));
  renderer.views.clear();
  for (std::uint32_t i = 0; i < count; ++i) {
    STGS_SDK_TRY(check_view(known[i]));
    renderer.views.push_back(view_of(known[i]));
  }
  return {};
}

Outcome copy_in_arguments(stgs_renderer& renderer, const stgs_scene* scene, double& seconds,
                          const stgs_view* views, const stgs_image* images, std::uint32_t count,
                          Images& known) {
  STGS_SDK_TRY(clamp_time(scene, seconds));
  STGS_SDK_TRY(copy_in_views(renderer, views, count));
  if (images == nullptr) return {STGS_ERROR_ARGUMENT, "images is NULL"};
  known = {};
  STGS_SDK_TRY(copy_in_array(images, std::span(known).first(count), "images"));
  for (std::uint32_t i = 0; i < count; ++i) {
    const auto& camera = renderer.views[i].camera;
    STGS_SDK_TRY(check_image(known[i], static_cast<std::uint32_t>(camera.width),
                             static_cast<std::uint32_t>(camera.height)));
  }
  return {};
}

Outcome render(stgs_renderer& renderer, stgs_scene& scene, double seconds) {
  STGS_SDK_TRY(scene.check_memory(seconds));
  const ScopedTaskRunner use(renderer.tasks.get());
  player::RenderStats stats;
  Status status = renderer.backend->draw(*scene.timeline, seconds, renderer.views,
                                         renderer.measure ? &stats : nullptr);
  if (renderer.measure && status.ok()) renderer.stats = stats;
  scene.log_new_damage();
  return status;
}

}  // namespace stgs::sdk

extern "C" {

stgs_result stgs_renderer_settings_defaults(stgs_renderer_settings* settings, size_t struct_size) {
  return stgs::sdk::fill_defaults(settings, struct_size, default_renderer_settings());
}

stgs_result stgs_renderer_create(const stgs_renderer_settings* settings, stgs_renderer** out) {
  return stgs::sdk::create_renderer(settings, out, make_backend);
}

void stgs_renderer_destroy(stgs_renderer* renderer) {
  delete renderer;
}

stgs_result stgs_renderer_error(const stgs_renderer* renderer, stgs_error* error) {
  return renderer == nullptr ? STGS_ERROR_ARGUMENT : renderer->error.get(error);
}

stgs_result stgs_renderer_get_backend(stgs_renderer* renderer, stgs_backend* out) {
  return guarded(renderer, [&]() -> Outcome {
    if (out == nullptr) return {STGS_ERROR_ARGUMENT, "out is NULL"};
    const std::string name = renderer->backend->name();
    for (stgs_backend i = STGS_BACKEND_CPU; i <= STGS_BACKEND_VULKAN; ++i) {
      if (name == kBackends[i]) *out = i;
    }
    return {};
  });
}

stgs_result stgs_renderer_get_statistics(stgs_renderer* renderer,
                                         stgs_render_statistics* statistics) {
  return guarded(renderer, [&]() -> Outcome {
    STGS_SDK_TRY(stgs::sdk::check_struct(statistics, "statistics"));
    if (!renderer->stats) {
      return {STGS_ERROR_STATE,
              renderer->measure
                  ? "nothing has been rendered yet; call stgs_render first"
                  : "the renderer does not measure; create it with stgs_renderer_settings.measure"};
    }
    const stgs::player::RenderStats& stats = *renderer->stats;
    stgs::sdk::copy_out(
        statistics, {sizeof(*statistics), stats.stored, stats.active, stats.splats, stats.fetch_ms,
                     stats.slice_ms, stats.bin_ms, stats.blend_ms, stats.device_ms});
    return {};
  });
}

stgs_result stgs_render(stgs_renderer* renderer, stgs_scene* scene, double seconds,
                        const stgs_view* views, const stgs_image* images, uint32_t count) {
  return guarded(renderer, [&]() -> Outcome {
    stgs::sdk::Images known;
    STGS_SDK_TRY(
        stgs::sdk::copy_in_arguments(*renderer, scene, seconds, views, images, count, known));
    STGS_SDK_TRY(stgs::sdk::render(*renderer, *scene, seconds));
    STGS_SDK_TRY(renderer->backend->read(renderer->frames));
    for (std::uint32_t i = 0; i < count; ++i) {
      stgs::sdk::write_image(renderer->frames[i], known[i]);
    }
    return {};
  });
}

}  // extern "C"
