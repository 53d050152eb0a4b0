// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <random>

#include "catch.h"
#include "stgs/encoder/metrics.h"

namespace stgs::encoder {
namespace {

Image noise(int width, int height, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
  Image image;
  image.reshape(width, height, 3);
  for (float& v : image.data) v = uniform(random);
  return image;
}

// SSIM by its definition: window by window with a two-dimensional Gaussian, in double precision.
double plain_ssim(const Image& a, const Image& b, double range) {
  double total = 0;
  int count = 0;
  for (int c = 0; c < 3; ++c) {
    for (int y = 5; y + 5 < a.height; ++y) {
      for (int x = 5; x + 5 < a.width; ++x) {
        double weights = 0, ma = 0, mb = 0;
        for (int j = -5; j <= 5; ++j) {
          for (int i = -5; i <= 5; ++i) {
            const double w = std::exp(-(i * i + j * j) / 4.5);
            weights += w;
            ma += w * a.plane(c)[(y + j) * a.width + x + i];
            mb += w * b.plane(c)[(y + j) * a.width + x + i];
          }
        }
        ma /= weights;
        mb /= weights;
        double va = 0, vb = 0, cov = 0;
        for (int j = -5; j <= 5; ++j) {
          for (int i = -5; i <= 5; ++i) {
            const double w = std::exp(-(i * i + j * j) / 4.5) / weights;
            const double da = a.plane(c)[(y + j) * a.width + x + i] - ma;
            const double db = b.plane(c)[(y + j) * a.width + x + i] - mb;
            va += w * da * da;
            vb += w * db * db;
            cov += w * da * db;
          }
        }
        const double c1 = 1e-4 * range * range, c2 = 9e-4 * range * range;
        total += (2 * ma * mb + c1) * (2 * cov + c2) / ((ma * ma + mb * mb + c1) * (va + vb + c2));
        ++count;
      }
    }
  }
  return total / count;
}

TEST_CASE("the PSNR of a constant offset is exact") {
  const Image a = noise(20, 15, 1);
  Image b = a;
  for (float& v : b.data) v += 0.125f;
  REQUIRE(mean_squared_error(a, b) == Approx(1.0 / 64).epsilon(1e-5));
  REQUIRE(psnr_of(1.0 / 64) == Approx(18.0618).epsilon(1e-5));
  REQUIRE(max_difference(a, b) == Approx(0.125).epsilon(1e-5));
  REQUIRE(psnr_of(0) == kPsnrMax);
}

TEST_CASE("a pixel that is not finite is named, and no metric hides it") {
  const Image valid = noise(20, 15, 1);
  REQUIRE(check_finite(valid, "a.exr").ok());
  for (const float value : {std::nanf(""), HUGE_VALF, -HUGE_VALF}) {
    Image invalid = valid;
    invalid.plane(2)[4 * 20 + 7] = value;
    const Status status = check_finite(invalid, "a.exr");
    REQUIRE(status.code() == StatusCode::kInvalidFile);
    REQUIRE(status.message().find("a.exr: channel B of pixel (7, 4) is") == 0);
    REQUIRE_FALSE(psnr_of(mean_squared_error(valid, invalid)) > 0);
  }
  REQUIRE(std::isnan(psnr_of(std::nan(""))));
}

TEST_CASE("SSIM agrees with its definition") {
  const Image a = noise(23, 17, 2), n = noise(23, 17, 3);
  Image b = a;
  for (std::size_t i = 0; i < b.data.size(); ++i) b.data[i] = 0.8f * a.data[i] + 0.2f * n.data[i];
  const auto measured = ssim(a, b);
  REQUIRE(measured.ok());
  REQUIRE(measured->range_1 == Approx(plain_ssim(a, b, 1)).margin(1e-4));
  REQUIRE(measured->range_2 == Approx(plain_ssim(a, b, 2)).margin(1e-4));
  REQUIRE(measured->range_1 < measured->range_2);
  REQUIRE(ssim(a, a)->range_1 == Approx(1.0));
  REQUIRE(ssim(noise(10, 40, 1), noise(10, 40, 2)).status().code() == StatusCode::kUnsupported);
}

TEST_CASE("colour correction removes an affine colour map and nothing else") {
  const Image ground_truth = noise(24, 18, 4);
  Image mapped = ground_truth;
  const std::size_t pixels = 24 * 18;
  for (std::size_t i = 0; i < pixels; ++i) {
    const float r = ground_truth.data[i], g = ground_truth.data[pixels + i],
                b = ground_truth.data[2 * pixels + i];
    mapped.data[i] = 0.9f * r + 0.05f * g + 0.02f;
    mapped.data[pixels + i] = 0.7f * g - 0.1f * b + 0.1f;
    mapped.data[2 * pixels + i] = 0.1f * r + 0.8f * b;
  }
  REQUIRE(psnr_of(mean_squared_error(mapped, ground_truth)) < 25);
  REQUIRE(colour_corrected_error(mapped, ground_truth) < 1e-10);
  const Image other = noise(24, 18, 5);
  REQUIRE(colour_corrected_error(other, ground_truth) <= mean_squared_error(other, ground_truth));
  REQUIRE(colour_corrected_error(other, ground_truth) > 0.05);
  // The best map of a constant image is the mean of the ground truth, which leaves the variance.
  Image grey = ground_truth;
  for (float& v : grey.data) v = 0.5f;
  double variance = 0;
  for (int c = 0; c < 3; ++c) {
    double sum = 0, squares = 0;
    for (std::size_t i = 0; i < pixels; ++i) {
      sum += ground_truth.plane(c)[i];
      squares += static_cast<double>(ground_truth.plane(c)[i]) * ground_truth.plane(c)[i];
    }
    variance += squares / pixels - sum * sum / (pixels * pixels);
  }
  REQUIRE(colour_corrected_error(grey, ground_truth) == Approx(variance / 3).epsilon(1e-6));
}

}  // namespace
}  // namespace stgs::encoder
