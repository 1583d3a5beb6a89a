//! Kernels are compiled with the instructions of their tier, down to the last function.
//!
//! What the compiler does not inline into a function of a tier - a closure, most of all - is
//! compiled without the tier's instructions, and each of its intrinsics is a call: some ten
//! times slower, with the same results, on every machine of that tier and on no other. So
//! the program is searched for such calls, those of tiers that this machine lacks too.

#![cfg(all(feature = "cli", target_arch = "x86_64", target_os = "linux", not(debug_assertions)))]

use std::collections::{BTreeMap, BTreeSet};

use object::{Object, ObjectSection, ObjectSymbol, SymbolKind};

/// What a constructor that fills its buffers may call, with numbers or with truth values.
const SPLATS: [&str; 3] = ["_mm512_set1_pd", "_mm256_set1_pd", "_mm256_castsi256_pd"];

/// `crate::path::name` of a symbol that is an intrinsic on double precision.
fn intrinsic(symbol: &str) -> Option<&str> {
    let (path, name) = symbol.rsplit_once("::")?;
    (path.starts_with("core::core_arch::x86::") && name.contains("_pd")).then_some(name)
}

#[test]
fn intrinsics_are_not_called() {
    let program = std::fs::read(env!("CARGO_BIN_EXE_mmae")).unwrap();
    let file = object::File::parse(&*program).unwrap();
    let text = file.section_by_name(".text").unwrap();
    let (code, base) = (text.data().unwrap(), text.address());

    let mut functions = BTreeMap::new();
    for symbol in file.symbols().filter(|s| s.kind() == SymbolKind::Text) {
        let name = format!("{:#}", rustc_demangle::demangle(symbol.name().unwrap()));
        functions.insert(symbol.address(), name);
    }
    assert!(functions.len() > 1000, "the program has been stripped of its symbols");

    let mut kernels = 0;
    let mut wrong = BTreeSet::new();
    for (at, bytes) in code.windows(5).enumerate() {
        // a near call or jump, by an offset from its own end
        let (0xe8 | 0xe9, offset) = (bytes[0], &bytes[1..]) else { continue };
        let offset = i32::from_le_bytes(offset.try_into().unwrap());
        let from = base + at as u64;
        let to = from.wrapping_add(5).wrapping_add_signed(offset.into());
        let Some(target) = functions.get(&to) else { continue };
        kernels += usize::from(target.contains("simd::dispatch::run_avx512"));
        let Some(name) = intrinsic(target).filter(|n| !SPLATS.contains(n)) else { continue };
        let caller = functions.range(..=from).next_back().map_or("?", |(_, name)| name);
        wrong.insert(format!("{caller} calls {name}"));
    }
    assert!(kernels > 10, "the search finds no kernels: {kernels}");
    assert!(wrong.is_empty(), "compiled without their tier's instructions: {wrong:#?}");
}
