// SPDX-License-Identifier: Apache-2.0
// Catch2 2 or 3. Tests include this header and use the names of version 2.
#pragma once

#if __has_include(<catch2/catch_all.hpp>)
#include <catch2/catch_approx.hpp>
#include <catch2/catch_test_macros.hpp>
#include <catch2/generators/catch_generators_all.hpp>
#include <catch2/matchers/catch_matchers_string.hpp>
#include <string>
#ifdef CATCH_CONFIG_RUNNER
#include <catch2/catch_session.hpp>
#endif
#ifdef CATCH_CONFIG_EXTERNAL_INTERFACES
#include <catch2/reporters/catch_reporter_event_listener.hpp>
#include <catch2/reporters/catch_reporter_registrars.hpp>
#endif

using Catch::Approx;

namespace Catch {
inline auto Contains(const std::string& part) {
  return Matchers::ContainsSubstring(part);
}
#ifdef CATCH_CONFIG_EXTERNAL_INTERFACES
using TestEventListenerBase = EventListenerBase;
#endif
}  // namespace Catch

#else
#include <catch2/catch.hpp>
#endif
