//! Checks a file's Authenticode signature.

use std::ffi::c_void;
use std::fs::{File, OpenOptions};
use std::os::windows::fs::OpenOptionsExt;
use std::os::windows::io::AsRawHandle;
use std::path::Path;

use windows::Win32::Foundation::{HANDLE, HWND};
use windows::Win32::Security::Cryptography::{CERT_NAME_SIMPLE_DISPLAY_TYPE, CertGetNameStringW};
use windows::Win32::Security::WinTrust::{
    WINTRUST_ACTION_GENERIC_VERIFY_V2, WINTRUST_DATA, WINTRUST_DATA_0, WINTRUST_FILE_INFO,
    WTD_CACHE_ONLY_URL_RETRIEVAL, WTD_CHOICE_FILE, WTD_REVOKE_NONE, WTD_STATEACTION_CLOSE, WTD_STATEACTION_VERIFY,
    WTD_UI_NONE, WTHelperGetProvCertFromChain, WTHelperGetProvSignerFromChain, WTHelperProvDataFromStateData,
    WinVerifyTrust,
};
use windows::core::PCWSTR;

use crate::libraries::wide;
use crate::{Error, ErrorKind, Result};

/// Prefix of the name in AMD's certificates.
const AMD: &str = "Advanced Micro Devices";

/// A file signed by AMD, which cannot be altered while this lives.
pub(super) struct Signed {
    pub(super) signer: String,
    _held: File,
}

/// Opens the file without sharing it for writing, and checks that it is unaltered and signed by AMD.
///
/// # Errors
/// `RuntimeMissing` for a file that is not signed, was altered, or whose signer is not trusted or not AMD.
pub(super) fn check(path: &Path) -> Result<Signed> {
    let (code, signer, held) = verify(path)?;
    match (code, signer) {
        (0, Some(signer)) if signer.starts_with(AMD) => Ok(Signed { signer, _held: held }),
        (0, signer) => Err(refused(path, &format!("it is signed by {}", signer.as_deref().unwrap_or("nobody known")))),
        (code, signer) => {
            let whose = signer.map_or(String::new(), |signer| format!(", signed by {signer}"));
            Err(refused(path, &format!("{} ({code:#010x}{whose})", meaning(code))))
        }
    }
}

/// Checks the signature in a library's file, whoever signed it, and returns the signer's name. Looks at no catalogue: files of Windows itself
/// are signed in one, and have no signature of their own. Uses no network. Windows only.
///
/// # Errors
/// `RuntimeMissing` for a file that is not signed, was altered, or whose signer is not trusted; `Io` for one that cannot be read.
pub fn signer_of(path: &Path) -> Result<String> {
    let (code, signer, _) = verify(path)?;
    let whose = signer.clone().map_or(String::new(), |signer| format!(", signed by {signer}"));
    signer.filter(|_| code == 0).ok_or_else(|| {
        Error::new(ErrorKind::RuntimeMissing, format!("{} ({code:#010x}{whose})", meaning(code)))
            .field(path.display().to_string())
            .remedy("Use the signed file of its maker")
    })
}

/// The result of the check of a signature, 0 for a right one, with the signer's name and the file, which cannot be altered while it is held.
fn verify(path: &Path) -> Result<(i32, Option<String>, File)> {
    const SHARE_READ: u32 = 1;
    let held = OpenOptions::new().read(true).share_mode(SHARE_READ).open(path);
    let held = held.map_err(|e| Error::new(ErrorKind::Io, e.to_string()).field(path.display().to_string()))?;
    let name = wide(path);
    let mut file = WINTRUST_FILE_INFO {
        cbStruct: size_of::<WINTRUST_FILE_INFO>() as u32,
        pcwszFilePath: PCWSTR(name.as_ptr()),
        hFile: HANDLE(held.as_raw_handle()),
        ..Default::default()
    };
    let mut data = WINTRUST_DATA {
        cbStruct: size_of::<WINTRUST_DATA>() as u32,
        dwUIChoice: WTD_UI_NONE,
        fdwRevocationChecks: WTD_REVOKE_NONE,
        dwUnionChoice: WTD_CHOICE_FILE,
        Anonymous: WINTRUST_DATA_0 { pFile: &mut file },
        dwStateAction: WTD_STATEACTION_VERIFY,
        // No network access: the check must not wait for it.
        dwProvFlags: WTD_CACHE_ONLY_URL_RETRIEVAL,
        ..Default::default()
    };
    let verify = |data: &mut WINTRUST_DATA| {
        let mut action = WINTRUST_ACTION_GENERIC_VERIFY_V2;
        let data: *mut WINTRUST_DATA = data;
        // SAFETY: both structs state their size, and all they point to lives during the call.
        unsafe { WinVerifyTrust(HWND::default(), &mut action, data.cast::<c_void>()) }
    };
    let code = verify(&mut data);
    let signer = signer(data.hWVTStateData);
    data.dwStateAction = WTD_STATEACTION_CLOSE;
    verify(&mut data);
    Ok((code, signer, held))
}

/// The first signer's name.
fn signer(state: HANDLE) -> Option<String> {
    // SAFETY: the state that the check returned, or null; each call gets the result of the previous one.
    let certificate = unsafe {
        let data = WTHelperProvDataFromStateData(state);
        if data.is_null() {
            return None;
        }
        let signer = WTHelperGetProvSignerFromChain(data, 0, false, 0);
        if signer.is_null() {
            return None;
        }
        WTHelperGetProvCertFromChain(signer, 0).as_ref()?.pCert
    };
    if certificate.is_null() {
        return None;
    }
    let mut name = [0; 256];
    // SAFETY: a certificate of the state, and the slice's memory.
    let length = unsafe { CertGetNameStringW(certificate, CERT_NAME_SIMPLE_DISPLAY_TYPE, 0, None, Some(&mut name)) };
    let name = String::from_utf16_lossy(&name[..(length as usize).saturating_sub(1)]);
    Some(name).filter(|name| !name.is_empty())
}

fn refused(path: &Path, why: &str) -> Error {
    Error::new(ErrorKind::RuntimeMissing, format!("only AMD's own files are to be loaded, and this is none: {why}"))
        .field(path.display().to_string())
        .remedy("Use the signed file of AMD's FidelityFX SDK")
}

/// The meaning of the check's result code.
fn meaning(code: i32) -> &'static str {
    match code.cast_unsigned() {
        0x800b_0100 => "it has no signature",
        0x8009_6010 => "it was altered after it was signed",
        0x800b_0109 => "its signer's root is not trusted on this machine",
        0x800b_010a => "no chain leads from its signer to a trusted root",
        0x800b_0101 => "its signature is out of date",
        0x800b_010c => "its signer's certificate was revoked",
        0x800b_0111 => "its signer is distrusted on this machine",
        _ => "its signature does not hold",
    }
}
