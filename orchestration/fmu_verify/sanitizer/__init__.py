"""Run FMUs that have C sources in a build with AddressSanitizer, LeakSanitizer and UBSan."""
