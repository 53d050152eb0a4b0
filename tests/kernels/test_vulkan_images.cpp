// SPDX-License-Identifier: Apache-2.0
// Rendering on a borrowed device into images of its owner, compared with the CPU renderer, with the
// validation layer if it is installed. Exit code 77: no device found.
#include <chrono>
#include <thread>

#include "vulkan_images.h"

using namespace stgs;
using namespace stgs::player;
using namespace stgs::testing;

TEST_CASE("images of every supported format match the CPU renderer") {
  const auto renderer = renderer_on(host());
  const auto timeline = make_timeline(random_scene(4000, 2, 60, 5));
  const Frame expected = render_on_cpu(*timeline, kSeconds, make_view());
  for (const PixelLayout& layout : pixel_layouts()) {
    INFO("VkFormat " << layout.format);
    const HostImage image = host().make_image(layout.format, kWidth, kHeight);
    check(renderer->submit(*timeline, kSeconds, {make_view()}, submission_to(image)).status());
    check(renderer->wait());
    const auto d = difference(expected, host().read(image, kReadable, layout.bytes), layout);
    CHECK(d.psnr >= 50);
    CHECK(d.alpha <= (layout.format == VK_FORMAT_A2B10G10R10_UNORM_PACK32 ? 0.17 : 0.004));
    const VulkanFrame frame = *renderer->last_completed();
    CHECK(frame.complete);
    CHECK(frame.stats.splats > 0);
    CHECK(frame.stats.active >= frame.stats.splats);
  }
}

TEST_CASE("several views render into image layers and levels, with depth") {
  const auto renderer = renderer_on(host());
  const auto timeline = make_timeline(random_scene(3000, 1, 60, 6));
  std::vector<View> views = {make_view(), make_view(), make_view(kWidth / 2, kHeight / 2)};
  views[1].camera.translation.x += 0.3f;
  // Two eyes with asymmetric frusta, one of them foveated, and a small view.
  views[0].camera.cx += 14;
  views[1].camera.cx -= 14;
  views[1].fovea = Fovea{{kWidth / 3.0f, kHeight / 2.0f}, 40.0f};
  const HostImage colour = host().make_image(VK_FORMAT_R8G8B8A8_UNORM, kWidth, kHeight, 2, 2);
  const HostImage depth = host().make_image(VK_FORMAT_R32_SFLOAT, kWidth, kHeight);
  VulkanSubmission submission;
  submission.targets = {{target_image(colour), {}},
                        {target_image(colour), target_image(depth)},
                        {target_image(colour), {}}};
  submission.targets[1].colour.layer = 1;
  submission.targets[2].colour.level = 1;
  submission.targets[2].colour.width /= 2;
  submission.targets[2].colour.height /= 2;
  check(renderer->submit(*timeline, kSeconds, views, submission).status());
  const PixelLayout& layout = pixel_layout(colour.format);
  const std::uint32_t level_and_layer[][2] = {{0, 0}, {0, 1}, {1, 0}};
  for (std::size_t i = 0; i < views.size(); ++i) {
    const auto found =
        host().read(colour, kReadable, layout.bytes, level_and_layer[i][0], level_and_layer[i][1]);
    CHECK(difference(render_on_cpu(*timeline, kSeconds, views[i]), found, layout).psnr >= 50);
  }
  const Frame expected = render_on_cpu(*timeline, kSeconds, views[1]);
  const auto found = host().read(depth, kReadable, 4);
  std::size_t far = 0;
  for (std::size_t i = 0; i < expected.depth.data.size(); ++i) {
    const float target = expected.depth.data[i], value = load<float>(found.data() + 4 * i);
    far += !(std::abs(target - value) <= target / 255);
  }
  CHECK(far <= 2);
}

TEST_CASE("a frame waits for its semaphores without blocking the caller") {
  const auto renderer = renderer_on(host());
  const auto timeline = make_timeline(random_scene(2000, 0, 60, 7));
  const HostImage image = host().make_image(VK_FORMAT_R8G8B8A8_UNORM, kWidth, kHeight);
  check(renderer->submit(*timeline, 0.1, {make_view()}, submission_to(image)).status());
  check(renderer->wait());
  const auto before = host().read(image, kReadable, 4);
  const VkSemaphore free = host().make_timeline(3), ready = host().make_timeline(0);
  VulkanSubmission submission = submission_to(image);
  submission.targets[0].colour.initial_layout = kReadable;
  submission.wait = {{free, 5}};
  submission.signal = {{ready, 9}};
  const auto number = renderer->submit(*timeline, kSeconds, {make_view()}, submission);
  check(number.status());
  CHECK(*number == 2);
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  CHECK(host().value_of(ready) == 0);
  CHECK(renderer->last_completed()->number == 1);
  host().signal(free, 5);
  check(renderer->wait());
  CHECK(host().value_of(ready) == 9);
  CHECK(renderer->last_completed()->number == 2);
  CHECK(psnr(render_on_cpu(*timeline, kSeconds, make_view()), host(), image) >= 50);
  CHECK(host().read(image, kReadable, 4) != before);
}

TEST_CASE("many frames in flight each render their own time and view") {
  const auto renderer = renderer_on(host());
  const auto timeline = make_timeline(random_scene(3000, 1, 60, 8));
  std::vector<HostImage> images;
  for (std::uint64_t k = 0; k < 8; ++k) {
    // One is larger, so that frames need more memory.
    const std::uint32_t width = kWidth + (k == 5 ? 200 : 0);
    images.push_back(host().make_image(VK_FORMAT_B8G8R8A8_UNORM, width, kHeight));
    const auto number = renderer->submit(*timeline, 0.2 * static_cast<double>(k),
                                         {make_view(width, kHeight)}, submission_to(images.back()));
    check(number.status());
    CHECK(*number == k + 1);
    const std::uint64_t completed = renderer->last_completed()->number;
    CHECK(completed <= *number);
    CHECK(completed + VulkanRenderer::kMaxFramesInFlight >= *number);
  }
  for (std::size_t k = 0; k < images.size(); ++k) {
    INFO("frame " << k + 1);
    const View view = make_view(images[k].width, kHeight);
    CHECK(psnr(render_on_cpu(*timeline, 0.2 * static_cast<double>(k), view), host(), images[k]) >=
          50);
  }
  check(renderer->wait());
  CHECK(renderer->last_completed()->number == images.size());
  // render() and submit() can be mixed.
  std::vector<Frame> frames;
  check(renderer->render(*timeline, kSeconds, {make_view()}, frames, nullptr));
  const Frame expected = render_on_cpu(*timeline, kSeconds, make_view());
  double squares = 0;
  for (std::size_t i = 0; i < expected.colour.data.size(); ++i) {
    squares += std::pow(expected.colour.data[i] - frames[0].colour.data[i], 2);
  }
  CHECK(squares / static_cast<double>(expected.colour.data.size()) < 1e-5);
}

TEST_CASE("segments are loaded and evicted while frames in flight use them") {
  const auto renderer = renderer_on(host());
  const Scene scene = random_scene(6000, 1, 60, 21);
  const auto ample = make_timeline(scene);
  WriteSettings settings;
  settings.chunk_seconds = 0.3;
  auto bytes = encode_scene(scene, settings);
  check(bytes.status());
  auto reader = SceneReader::open(memory_source(std::move(*bytes)));
  check(reader.status());
  const auto tight = Timeline::from_reader(std::move(*reader), "the scene", 700'000);
  std::vector<HostImage> images;
  std::vector<double> times;
  for (int k = 0, i = 11; k < 30; ++k, i = (i + 37) % 60) {
    times.push_back(i / 30.0);
    images.push_back(host().make_image(VK_FORMAT_R8G8B8A8_UNORM, kWidth, kHeight));
    check(renderer->submit(*tight, times.back(), {make_view()}, submission_to(images.back()))
              .status());
  }
  check(renderer->wait());
  CHECK(renderer->last_completed()->stats.stored < scene.gaussians.size());
  for (std::size_t k = 0; k < images.size(); ++k) {
    INFO("time " << times[k]);
    CHECK(psnr(render_on_cpu(*ample, times[k], make_view()), host(), images[k]) >= 50);
  }
}

TEST_CASE(
    "a frame with too many tile instances omits the farthest splats, reports it, and the next "
    "frame is complete") {
  const auto renderer = renderer_on(host(), 400);
  const auto timeline = make_timeline(random_scene(3000, 0, 60, 9));
  const HostImage image = host().make_image(VK_FORMAT_R8G8B8A8_UNORM, kWidth, kHeight);
  const Frame expected = render_on_cpu(*timeline, kSeconds, make_view());
  Frame background_only = expected;
  for (int c = 0; c < 3; ++c) {
    const float background[] = {0.2f, 0.5f, 0.7f};
    std::fill_n(background_only.colour.plane(c), kWidth * kHeight, background[c]);
  }
  double before = 0;
  for (int k = 0; k < 2; ++k) {
    check(renderer->submit(*timeline, kSeconds, {make_view()}, submission_to(image)).status());
    check(renderer->wait());
    CHECK(renderer->last_completed()->complete == (k == 1));
    const double now = psnr(expected, host(), image);
    if (k == 0) {
      // More than the background.
      CHECK(psnr(background_only, host(), image) < 60);
      CHECK(now < 50);
      before = now;
    } else {
      CHECK(now >= 50);
      CHECK(now > before);
    }
  }
}

TEST_CASE("an invalid submission is rejected with its reason, and nothing is submitted") {
  const auto renderer = renderer_on(host());
  const auto timeline = make_timeline(random_scene(200, 0, 60, 3));
  const HostImage image = host().make_image(VK_FORMAT_R8G8B8A8_UNORM, kWidth, kHeight);
  const HostImage bytes = host().make_image(VK_FORMAT_R8_UNORM, kWidth, kHeight);
  const auto check_rejected = [&](const VulkanSubmission& submission, StatusCode code,
                                  const char* word) {
    const auto number = renderer->submit(*timeline, kSeconds, {make_view()}, submission);
    INFO(number.status().message());
    CHECK(number.status().code() == code);
    CHECK(number.status().message().find(word) != std::string::npos);
  };
  check_rejected({}, StatusCode::kUsage, "targets");
  VulkanSubmission submission = submission_to(image);
  submission.targets[0].colour.image = VK_NULL_HANDLE;
  check_rejected(submission, StatusCode::kUsage, "missing");
  submission = submission_to(image);
  submission.targets[0].colour.width += 1;
  check_rejected(submission, StatusCode::kUsage, "161x96");
  check_rejected(submission_to(bytes), StatusCode::kUsage, "format");
  submission = submission_to(image);
  submission.targets[0].depth = target_image(image);
  check_rejected(submission, StatusCode::kUsage, "depth");
  submission = submission_to(image);
  submission.targets[0].colour.final_layout = VK_IMAGE_LAYOUT_UNDEFINED;
  check_rejected(submission, StatusCode::kUsage, "layout");
  submission = submission_to(image);
  submission.wait = {{VK_NULL_HANDLE, 1}};
  check_rejected(submission, StatusCode::kUsage, "semaphore");
  CHECK(renderer->submit(*timeline, NAN, {make_view()}, submission_to(image)).status().code() ==
        StatusCode::kUsage);
  check(renderer->wait());
  CHECK(renderer->last_completed()->number == 0);
}

int main(int argc, char** argv) {
  return stgs::testing::run_vulkan_cases(argc, argv);
}
