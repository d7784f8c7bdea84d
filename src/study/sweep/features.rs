//! Processor features that numerical libraries choose among when the program starts: the last digits of an answer may
//! depend on them.

/// Returns the processor architecture, with the features of it that the program uses.
pub fn features() -> String {
    let mut features = std::env::consts::ARCH.to_owned();
    #[cfg(target_arch = "x86_64")]
    for (name, is_here) in [
        ("avx2", std::arch::is_x86_feature_detected!("avx2")),
        ("fma", std::arch::is_x86_feature_detected!("fma")),
        ("avx512f", std::arch::is_x86_feature_detected!("avx512f")),
    ] {
        if is_here {
            features.push('+');
            features.push_str(name);
        }
    }
    features
}
